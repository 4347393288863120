#include <algorithm>
#include <limits>
#include <memory>
#include <numeric>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/reduced_graph.h"
#include "adapters/compare_with_stock.h"
#include "adapters/test_problems.h"
#include "inceres/ceres/solve.h"

namespace inceres::internal {
namespace {

using testing::ShapeOnlyCost;
using testing::TestProblem;

// Cameras of 6 and points of 3 of which each is seen by some cameras; structure only.
class Bundle {
 public:
  Bundle(int num_cameras, unsigned seed) : random_(seed) {
    for (int c = 0; c < num_cameras; ++c) {
      cameras_.push_back(test_.Add(std::vector<double>(6, 1.0)));
    }
  }

  // Points seen by `track` neighbors of a random camera, or by any `track` cameras.
  Bundle& Add(int num_points, int track, bool neighbors) {
    std::vector<std::size_t> order(cameras_.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    for (int p = 0; p < num_points; ++p) {
      double* point = points_.emplace_back(test_.Add(std::vector<double>(3, 1.0)));
      if (neighbors) {
        const std::size_t first =
            std::uniform_int_distribution<std::size_t>(0, cameras_.size() - 1)(random_);
        std::iota(order.begin(), order.end(), first);
      } else {
        std::shuffle(order.begin(), order.end(), random_);
      }
      for (int k = 0; k < track; ++k) {
        double* camera = cameras_[order[static_cast<std::size_t>(k)] % cameras_.size()];
        test_.problem.AddResidualBlock(new ShapeOnlyCost(2, {6, 3}), nullptr, camera, point);
      }
      std::iota(order.begin(), order.end(), std::size_t{0});
    }
    return *this;
  }

  LandmarkSelection Select(const AvailableMemory& available = nullptr,
                           const std::vector<double*>* first_group = nullptr) {
    view_ = Introspect(test_.problem);
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_SCHUR;
    if (first_group != nullptr) {
      options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
      for (const ParameterBlockView& block : view_.blocks) {
        const bool first =
            std::find(first_group->begin(), first_group->end(), block.values) != first_group->end();
        options.linear_solver_ordering->AddElementToGroup(block.values, first ? 0 : 1);
      }
    }
    return SelectLandmarks(view_, ReadOrdering(options, view_), FindShapes(view_),
                           ceres::SPARSE_SCHUR, available);
  }

  bool IsLandmark(const LandmarkSelection& selection, double* point) const {
    return selection.Contains(view_.index.Find(point));
  }

  std::vector<double*>& points() { return points_; }
  ceres::Problem& problem() { return test_.problem; }

 private:
  std::mt19937 random_;
  TestProblem test_;
  std::vector<double*> cameras_;
  std::vector<double*> points_;
  ProblemView view_;
};

constexpr unsigned kSeeds[] = {1, 2, 3, 4};

TEST(LandmarkFill, FewPointsSeenByManyStay) {
  for (const unsigned seed : kSeeds) {
    for (const bool neighbors : {true, false}) {
      Bundle bundle(300, seed);
      const LandmarkSelection selection = bundle.Add(25, 100, neighbors).Select();
      EXPECT_EQ(selection.num_landmarks, 0) << "seed " << seed << (neighbors ? ", neighbors" : "");
      EXPECT_EQ(selection.num_kept, 25);
      EXPECT_EQ(selection.obstacle, "");
    }
  }
}

TEST(LandmarkFill, SoTheyDoWhereTheUserPutsThemFirst) {
  for (const unsigned seed : kSeeds) {
    Bundle bundle(300, seed);
    bundle.Add(25, 100, /*neighbors=*/false);
    EXPECT_EQ(bundle.Select(nullptr, &bundle.points()).num_landmarks, 0) << "seed " << seed;
  }
}

// No track is long, but there are so few points that the cameras would be coupled to each other by
// chance.
TEST(LandmarkFill, FewPointsOfShortTracksAnywhereStay) {
  for (const unsigned seed : kSeeds) {
    Bundle bundle(600, seed);
    EXPECT_EQ(bundle.Add(120, 30, /*neighbors=*/false).Select().num_landmarks, 0)
        << "seed " << seed;
  }
}

TEST(LandmarkFill, ManyPointsSeenByFewAreEliminated) {
  for (const unsigned seed : kSeeds) {
    Bundle bundle(80, seed);
    const LandmarkSelection selection = bundle.Add(3000, 5, /*neighbors=*/false).Select();
    EXPECT_EQ(selection.num_landmarks, 3000) << "seed " << seed;
    EXPECT_EQ(selection.num_kept, 0);
  }
}

TEST(LandmarkFill, PointsAlongAStreetAreEliminated) {
  for (const unsigned seed : kSeeds) {
    for (const int num_points : {2000, 8000}) {
      Bundle bundle(500, seed);
      EXPECT_EQ(bundle.Add(num_points, 5, /*neighbors=*/true).Select().num_landmarks, num_points)
          << "seed " << seed;
    }
  }
}

// A few points seen all along a street would fill what the others leave nearly empty.
TEST(LandmarkFill, OnlyTheLongTracksOfAStreetStay) {
  for (const unsigned seed : kSeeds) {
    Bundle bundle(400, seed);
    const LandmarkSelection selection =
        bundle.Add(4000, 5, /*neighbors=*/true).Add(10, 300, /*neighbors=*/false).Select();
    EXPECT_EQ(selection.num_landmarks, 4000) << "seed " << seed;
    EXPECT_EQ(selection.num_kept, 10);
    for (std::size_t p = 0; p < bundle.points().size(); ++p) {
      EXPECT_EQ(bundle.IsLandmark(selection, bundle.points()[p]), p < 4000);
    }
  }
}

TEST(LandmarkFill, SmallReducedSystemsAreLeftAlone) {
  Bundle bundle(50, 1);
  EXPECT_EQ(bundle.Add(12, 9, /*neighbors=*/false).Select().num_landmarks, 12);
}

TEST(LandmarkFill, MemoryThatFitsChangesNothing) {
  Bundle bundle(80, 1);
  bundle.Add(3000, 5, /*neighbors=*/false);
  EXPECT_EQ(bundle.Select([] { return 1e12; }).is_landmark, bundle.Select().is_landmark);
}

// Twice as many points as cameras: to eliminate them is a little cheaper, to leave them a little
// leaner. With less and less memory first the points stay, then nothing fits.
TEST(LandmarkFill, ALeanerChoiceIsTakenWhereMemoryIsShort) {
  Bundle bundle(600, 2);
  bundle.Add(1200, 30, /*neighbors=*/false);
  std::vector<int> num_landmarks;
  LandmarkSelection selection;
  for (double limit = 180.0 * (1 << 20); limit > 1.0; limit *= 0.96) {
    selection = bundle.Select([limit] { return limit; });
    if (!selection.obstacle.empty()) {
      break;
    }
    num_landmarks.push_back(selection.num_landmarks);
  }
  ASSERT_FALSE(selection.obstacle.empty());
  ASSERT_FALSE(num_landmarks.empty());
  EXPECT_EQ(num_landmarks.front(), 1200);
  EXPECT_EQ(num_landmarks.back(), 0);
}

TEST(LandmarkFill, TheObstacleSaysHowMuchIsMissing) {
  for (const unsigned seed : kSeeds) {
    Bundle bundle(400, seed);
    const LandmarkSelection selection =
        bundle.Add(4000, 12, /*neighbors=*/false).Select([] { return 3.0 * (1 << 20); });
    EXPECT_NE(selection.obstacle.find("memory: a solve is predicted to take "), std::string::npos)
        << selection.obstacle;
    EXPECT_NE(selection.obstacle.find(" at least, 3 MiB are available"), std::string::npos)
        << selection.obstacle;
  }
}

TEST(LandmarkFill, AvailableBytesAreKnownHere) {
  EXPECT_GT(AvailableBytes(), 1 << 20);
}

// S by brute force: all pairs of frames that share a landmark, or a residual block without one.
TEST(ReducedGraph, PatternIsThatOfTheReducedSystem) {
  for (const unsigned seed : kSeeds) {
    TestProblem test;
    std::mt19937 random(seed);
    std::vector<double*> frames, points;
    for (int k = 0; k < 20; ++k) {
      frames.push_back(test.Add(std::vector<double>(static_cast<std::size_t>(3 + k % 4), 1.0)));
    }
    for (int k = 0; k < 15; ++k) {
      points.push_back(test.Add({1.0, 1.0}));
    }
    const auto size = [&](double* block) { return test.problem.ParameterBlockSize(block); };
    const auto any = [&random](std::vector<double*>& blocks) {
      return blocks[std::uniform_int_distribution<std::size_t>(0, blocks.size() - 1)(random)];
    };
    for (double* block : frames) {
      test.problem.AddParameterBlock(
          block,
          3 + static_cast<int>(std::find(frames.begin(), frames.end(), block) - frames.begin()) %
                  4);
    }
    for (int k = 0; k < 40; ++k) {
      double* frame = any(frames);
      test.problem.AddResidualBlock(new ShapeOnlyCost(2, {size(frame), 2}), nullptr, frame,
                                    any(points));
    }
    for (int k = 0; k < 8; ++k) {
      double* a = any(frames);
      double* b = any(frames);
      if (a != b) {
        test.problem.AddResidualBlock(new ShapeOnlyCost(1, {size(a), size(b)}), nullptr, a, b);
      }
    }
    test.problem.SetParameterBlockConstant(frames[3]);
    const ProblemView view = Introspect(test.problem);
    std::vector<char> is_landmark(view.blocks.size(), 0);
    for (double* point : points) {
      const int b = view.index.Find(point);
      if (b >= 0) {
        is_landmark[static_cast<std::size_t>(b)] = view.IsReduced(b) ? 1 : 0;
      }
    }
    const ReducedGraph graph(view, is_landmark);
    const BlockPattern pattern = graph.Pattern();
    std::multiset<std::pair<int, int>> expected, found;  // sizes of the blocks that are there
    std::vector<std::set<int>> cliques(view.blocks.size() + view.residuals.size());
    for (std::size_t r = 0; r < view.residuals.size(); ++r) {
      const int* slots = view.SlotsOf(view.residuals[r]);
      const int* landmark = std::find_if(slots, slots + view.residuals[r].num_slots, [&](int b) {
        return is_landmark[static_cast<std::size_t>(b)] != 0;
      });
      const bool has = landmark != slots + view.residuals[r].num_slots;
      std::set<int>& clique =
          cliques[has ? static_cast<std::size_t>(*landmark) : view.blocks.size() + r];
      std::copy_if(slots, slots + view.residuals[r].num_slots, std::inserter(clique, clique.end()),
                   [&](int b) {
                     return view.IsReduced(b) && is_landmark[static_cast<std::size_t>(b)] == 0;
                   });
    }
    std::set<std::pair<int, int>> pairs;
    double elimination = 0.0;
    for (std::size_t b = 0; b < cliques.size(); ++b) {
      double frames_size = 0.0;
      for (const int i : cliques[b]) {
        frames_size += view.block(i).tangent_size;
        for (const int j : cliques[b]) {
          if (i <= j) {
            pairs.emplace(i, j);
          }
        }
      }
      elimination += b < view.blocks.size() ? 2.0 * frames_size * frames_size : 0.0;
    }
    for (const auto& [i, j] : pairs) {
      const std::pair<int, int> sizes =
          std::minmax({view.block(i).tangent_size, view.block(j).tangent_size});
      expected.emplace(sizes.first, sizes.second);
    }
    for (int row = 0; row < pattern.num_blocks(); ++row) {
      for (int k = pattern.row_begin[static_cast<std::size_t>(row)];
           k < pattern.row_begin[static_cast<std::size_t>(row) + 1]; ++k) {
        const std::pair<int, int> sizes =
            std::minmax({pattern.block_size(row),
                         pattern.block_size(pattern.columns[static_cast<std::size_t>(k)])});
        found.emplace(sizes.first, sizes.second);
      }
    }
    EXPECT_EQ(found, expected) << "seed " << seed;
    EXPECT_DOUBLE_EQ(graph.elimination_flops(), elimination);
  }
}

// r = R (a − b) + noise: enough to be solved. A user's points that are eliminated by stock and stay
// with us.
ceres::CostFunction* DifferenceCost(std::mt19937* random) {
  std::normal_distribution<double> normal;
  std::vector<double> a(20);
  for (double& entry : a) {
    entry = normal(*random);
  }
  return new lambdas::Formula(
      2, {6, 3}, [=](double const* const* parameters, double* residuals, double** jacobians) {
        const double* A = a.data();
        for (int r = 0; r < 2; ++r) {
          residuals[r] = A[18 + r];
          for (int k = 0; k < 6; ++k) {
            const double x = parameters[0][k];
            residuals[r] += A[6 * r + k] * x * (1.0 + 0.01 * x);
            jacobians[0][6 * r + k] = A[6 * r + k] * (1.0 + 0.02 * x);
          }
          for (int k = 0; k < 3; ++k) {
            residuals[r] += A[12 + 3 * r + k] * parameters[1][k];
            jacobians[1][3 * r + k] = A[12 + 3 * r + k];
          }
        }
        return true;
      });
}

TEST(LandmarkFill, SolvesAsStockAndReportsWhatTheUserAskedFor) {
  for (const unsigned seed : {7U, 8U}) {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_SCHUR;
    options.max_num_iterations = 5;
    const auto solve = [&](bool ours, SolveReport* report) {
      std::mt19937 random(seed);
      std::vector<double> cameras(6 * 80, 0.5), points(3 * 12, 0.2);
      ceres::Problem problem;
      auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
      for (std::size_t p = 0; p < 12; ++p) {
        for (std::size_t c = 0; c < 80; ++c) {
          problem.AddResidualBlock(DifferenceCost(&random), nullptr, &cameras[6 * c],
                                   &points[3 * p]);
          ordering->AddElementToGroup(&cameras[6 * c], 1);
        }
        ordering->AddElementToGroup(&points[3 * p], 0);
      }
      options.linear_solver_ordering = ordering;
      ceres::Solver::Summary summary;
      if (ours) {
        SolveOptions strict;
        strict.strict = true;
        inceres::Solve(options, &problem, &summary, strict, report);
      } else {
        ceres::Solve(options, &problem, &summary);
      }
      return summary;
    };
    SolveReport report;
    const ceres::Solver::Summary ours = solve(true, &report);
    const ceres::Solver::Summary stock = solve(false, nullptr);
    EXPECT_EQ(report.num_landmarks, 0);
    EXPECT_EQ(ours.linear_solver_ordering_used, stock.linear_solver_ordering_used);
    EXPECT_EQ(ours.schur_structure_given, stock.schur_structure_given);
    EXPECT_EQ(ours.schur_structure_used, stock.schur_structure_used);
    ASSERT_EQ(ours.iterations.size(), stock.iterations.size());
    for (std::size_t k = 0; k < ours.iterations.size(); ++k) {
      EXPECT_NEAR(ours.iterations[k].cost, stock.iterations[k].cost,
                  1e-9 * stock.iterations[k].cost);
    }
    ASSERT_EQ(report.options_without_effect.size(), 1U);
    EXPECT_NE(report.options_without_effect[0].find("12 blocks of the first group stay"),
              std::string::npos);
  }
}

}  // namespace
}  // namespace inceres::internal
