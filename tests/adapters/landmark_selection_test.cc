#include "adapters/ceres/plan/landmark_selection.h"

#include <algorithm>
#include <cstdint>

#include <gtest/gtest.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/test_problems.h"
#include "support/ceres_manifolds.h"

namespace inceres::internal {
namespace {

using testing::ShapeOnlyCost;
using testing::TestProblem;

// Structure only: the cost functions are never called.
class Structure {
 public:
  double* Block(int size) {
    return test_.Add(std::vector<double>(static_cast<std::size_t>(size), 1.0));
  }
  std::vector<double*> Blocks(int count, int size) {
    std::vector<double*> blocks;
    for (int k = 0; k < count; ++k) {
      blocks.push_back(Block(size));
    }
    return blocks;
  }
  void Factor(int num_residuals, const std::vector<double*>& blocks) {
    std::vector<int> sizes;
    for (const double* block : blocks) {
      const auto found = std::find_if(test_.blocks.begin(), test_.blocks.end(),
                                      [&](const auto& b) { return b.data() == block; });
      sizes.push_back(static_cast<int>(found->size()));
    }
    test_.problem.AddResidualBlock(new ShapeOnlyCost(num_residuals, sizes), nullptr, blocks);
  }
  void SetManifold(double* block, manifolds::AnyManifold* manifold) {
    manifolds::Set(&test_.problem, block, manifold);
  }
  ceres::Problem& problem() { return test_.problem; }

  // The chosen landmarks, after checking that they are independent.
  std::vector<const double*> Choose() {
    const ProblemView view = Introspect(test_.problem);
    const LandmarkSelection selection = ChooseLandmarks(view, FindShapes(view));
    for (const ResidualBlockView& residual : view.residuals) {
      const int* slots = view.SlotsOf(residual);
      EXPECT_LE(std::count_if(slots, slots + residual.num_slots,
                              [&](int b) { return selection.Contains(b); }),
                1);
    }
    std::vector<const double*> chosen;
    for (std::size_t b = 0; b < view.blocks.size(); ++b) {
      if (selection.is_landmark[b] != 0) {
        chosen.push_back(view.blocks[b].values);
      }
    }
    EXPECT_EQ(static_cast<int>(chosen.size()), selection.num_landmarks);
    return chosen;
  }

 private:
  TestProblem test_;
};

std::vector<const double*> Sorted(const std::vector<double*>& blocks) {
  std::vector<const double*> sorted(blocks.begin(), blocks.end());
  std::sort(sorted.begin(), sorted.end());
  return sorted;
}

// Kinds that cost the same go by the order of the problem, wherever their blocks lie in memory.
TEST(LandmarkSelection, AddressesDecideNothing) {
  constexpr int kCount = 30;
  for (const bool first_kind_lies_first : {true, false}) {
    std::vector<double> memory(2 * 3 * kCount, 1.0);
    double* const first = memory.data() + (first_kind_lies_first ? 0 : 3 * kCount);
    double* const second = memory.data() + (first_kind_lies_first ? 3 * kCount : 0);
    ceres::Problem problem;
    for (int i = 0; i < kCount; ++i) {
      for (const int step : {0, 1, 5}) {
        const std::vector<double*> blocks = {first + 3 * i, second + 3 * ((i + step) % kCount)};
        problem.AddResidualBlock(new ShapeOnlyCost(2, {3, 3}), nullptr, blocks);
      }
    }
    const ProblemView view = Introspect(problem);
    const LandmarkSelection selection = ChooseLandmarks(view, FindShapes(view));
    EXPECT_EQ(selection.num_landmarks, kCount);
    for (std::size_t b = 0; b < view.blocks.size(); ++b) {
      const bool is_of_first =
          view.blocks[b].values >= first && view.blocks[b].values < first + 3 * kCount;
      EXPECT_EQ(selection.is_landmark[b] != 0, is_of_first);
    }
  }
}

TEST(LandmarkSelection, BundleAdjustmentTakesAllPoints) {
  Structure s;
  const std::vector<double*> cameras = s.Blocks(6, 9);
  const std::vector<double*> points = s.Blocks(60, 3);
  for (std::size_t p = 0; p < points.size(); ++p) {
    for (std::size_t k = 0; k < 3; ++k) {
      s.Factor(2, {cameras[(p + k) % cameras.size()], points[p]});
    }
  }
  EXPECT_EQ(s.Choose(), Sorted(points));
}

// Camera split into quaternion, translation and focal length, all as small as a point: only the
// points may go.
TEST(LandmarkSelection, SplitCamerasStayFrames) {
  Structure s;
  const std::vector<double*> rotations = s.Blocks(8, 4);
  const std::vector<double*> translations = s.Blocks(8, 3);
  const std::vector<double*> focals = s.Blocks(8, 1);
  const std::vector<double*> points = s.Blocks(80, 3);
  for (std::size_t p = 0; p < points.size(); ++p) {
    for (std::size_t k = 0; k < 4; ++k) {
      const std::size_t c = (p + k) % rotations.size();
      s.Factor(2, {rotations[c], translations[c], points[p], focals[c]});
    }
  }
  for (double* rotation : rotations) {
    s.SetManifold(rotation, new manifolds::QuaternionManifold());
  }
  EXPECT_EQ(s.Choose(), Sorted(points));
}

TEST(LandmarkSelection, WindowTakesInverseDepthsButNotTheTimeOffset) {
  Structure s;
  const std::vector<double*> poses = s.Blocks(11, 7);
  const std::vector<double*> speed_biases = s.Blocks(11, 9);
  double* extrinsic = s.Block(7);
  double* time_offset = s.Block(1);
  const std::vector<double*> depths = s.Blocks(120, 1);
  for (std::size_t f = 0; f < depths.size(); ++f) {
    for (std::size_t k = 1; k < 5; ++k) {
      s.Factor(2, {poses[f % 7], poses[f % 7 + k], extrinsic, depths[f], time_offset});
    }
  }
  for (std::size_t i = 0; i + 1 < poses.size(); ++i) {
    s.Factor(15, {poses[i], speed_biases[i], poses[i + 1], speed_biases[i + 1]});
  }
  std::vector<double*> prior = poses;
  prior.push_back(extrinsic);
  prior.push_back(time_offset);
  s.Factor(78, prior);
  EXPECT_EQ(s.Choose(), Sorted(depths));
}

TEST(LandmarkSelection, HomogeneousPointsOnAManifoldAreTaken) {
  Structure s;
  const std::vector<double*> poses = s.Blocks(8, 7);
  const std::vector<double*> landmarks = s.Blocks(50, 4);
  double* extrinsic = s.Block(7);
  for (std::size_t l = 0; l < landmarks.size(); ++l) {
    for (std::size_t k = 0; k < 4; ++k) {
      s.Factor(2, {poses[(l + k) % 8], landmarks[l], extrinsic});
    }
  }
  for (double* landmark : landmarks) {
    s.SetManifold(landmark, new manifolds::SphereManifold<4>());
  }
  EXPECT_EQ(s.Choose(), Sorted(landmarks));
}

TEST(LandmarkSelection, PlanarPoseGraphHasNone) {
  Structure s;
  const std::vector<double*> poses = s.Blocks(100, 3);
  for (std::size_t i = 0; i + 1 < poses.size(); ++i) {
    s.Factor(3, {poses[i], poses[i + 1]});
  }
  for (std::size_t i = 0; i + 20 < poses.size(); i += 7) {
    s.Factor(3, {poses[i + 20], poses[i]});
  }
  EXPECT_TRUE(s.Choose().empty());
}

TEST(LandmarkSelection, SplitPoseGraphHasNone) {
  Structure s;
  const std::vector<double*> translations = s.Blocks(60, 3);
  const std::vector<double*> rotations = s.Blocks(60, 4);
  for (std::size_t i = 0; i + 1 < translations.size(); ++i) {
    s.Factor(6, {translations[i], rotations[i], translations[i + 1], rotations[i + 1]});
  }
  for (double* rotation : rotations) {
    s.SetManifold(rotation, new manifolds::EigenQuaternionManifold());
  }
  EXPECT_TRUE(s.Choose().empty());
}

TEST(LandmarkSelection, FullPoseGraphHasNone) {
  Structure s;
  const std::vector<double*> poses = s.Blocks(60, 7);
  for (std::size_t i = 0; i + 1 < poses.size(); ++i) {
    s.Factor(6, {poses[i], poses[i + 1]});
  }
  EXPECT_TRUE(s.Choose().empty());
}

TEST(LandmarkSelection, CurveFittingAndPowellHaveNone) {
  for (const auto& test : {testing::MakeCurveFit(0.0), testing::MakePowell()}) {
    const ProblemView view = Introspect(test->problem);
    EXPECT_EQ(ChooseLandmarks(view, FindShapes(view)).num_landmarks, 0);
  }
}

TEST(LandmarkSelection, FewCurvePointsHaveNoneEither) {
  Structure s;
  double* m = s.Block(1);
  double* c = s.Block(1);
  for (int k = 0; k < 5; ++k) {
    s.Factor(1, {m, c});
  }
  EXPECT_TRUE(s.Choose().empty())
      << "too few residual blocks for the rule of a fifth: the predicted cost decides";
}

TEST(LandmarkSelection, ABlockThatTouchesAFifthOfTheResidualsStaysAFrame) {
  for (const int num_others : {39, 41}) {
    Structure s;
    const std::vector<double*> poses = s.Blocks(10, 6);
    double* point = s.Block(3);
    for (std::size_t k = 0; k < 10; ++k) {
      s.Factor(2, {poses[k], point});
    }
    for (int k = 0; k < num_others; ++k) {
      s.Factor(6, {poses[static_cast<std::size_t>(k) % 10],
                   poses[static_cast<std::size_t>(k + 1) % 10]});
    }
    EXPECT_EQ(s.Choose().size(), num_others == 41 ? 1u : 0u) << num_others;
  }
}

TEST(LandmarkSelection, PointsTiedToEachOtherStayFrames) {
  Structure s;
  const std::vector<double*> cameras = s.Blocks(6, 6);
  std::vector<double*> points = s.Blocks(40, 3);
  for (std::size_t p = 0; p < points.size(); ++p) {
    for (std::size_t k = 0; k < 4; ++k) {
      s.Factor(2, {cameras[(p + k) % 6], points[p]});
    }
  }
  s.Factor(1, {points[38], points[39]});
  points.resize(38);
  EXPECT_EQ(s.Choose(), Sorted(points));
}

TEST(LandmarkSelection, ConstantPointsAreNoLandmarks) {
  Structure s;
  const std::vector<double*> cameras = s.Blocks(4, 6);
  const std::vector<double*> points = s.Blocks(30, 3);
  for (double* point : points) {
    for (double* camera : cameras) {
      s.Factor(2, {camera, point});
    }
    s.problem().SetParameterBlockConstant(point);
  }
  EXPECT_TRUE(s.Choose().empty());
}

TEST(LandmarkSelection, ConstantCamerasLeaveThePoints) {
  Structure s;
  const std::vector<double*> cameras = s.Blocks(4, 6);
  const std::vector<double*> points = s.Blocks(30, 3);
  for (double* point : points) {
    for (double* camera : cameras) {
      s.Factor(2, {camera, point});
    }
  }
  for (double* camera : cameras) {
    s.problem().SetParameterBlockConstant(camera);
  }
  EXPECT_EQ(s.Choose(), Sorted(points));
}

TEST(LandmarkSelection, UsersFirstGroupIsTakenAsFarAsItIsSmall) {
  Structure s;
  const std::vector<double*> cameras = s.Blocks(3, 6);
  const std::vector<double*> points = s.Blocks(5, 3);
  double* large = s.Block(5);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (double* camera : cameras) {
    options.linear_solver_ordering->AddElementToGroup(camera, 1);
    for (double* point : points) {
      s.Factor(2, {camera, point});
    }
    s.Factor(2, {camera, large});
  }
  for (double* point : points) {
    options.linear_solver_ordering->AddElementToGroup(point, 0);
  }
  options.linear_solver_ordering->AddElementToGroup(large, 0);
  s.problem().SetParameterBlockConstant(points[0]);

  const ProblemView view = Introspect(s.problem());
  const OrderingView ordering = ReadOrdering(options, view);
  EXPECT_EQ(ordering.group_sizes, (std::vector<int>{5, 3}));
  const LandmarkSelection selection = LandmarksOfFirstGroup(view, ordering);
  EXPECT_EQ(selection.num_landmarks, 4);
  EXPECT_EQ(selection.num_too_large, 1);
  EXPECT_FALSE(selection.Contains(view.index.Find(points[0]))) << "constant";
  EXPECT_FALSE(selection.Contains(view.index.Find(large)));
  EXPECT_EQ(options.linear_solver_ordering->NumElements(), 9)
      << "the caller's ordering is not edited";
}

// Points of two shapes of residual blocks in turn, which are in no order of theirs; so many that
// several threads share them.
TEST(GraphPlan, IsTheSameWithSeveralThreads) {
  constexpr int kNumCameras = 30;
  constexpr int kNumPoints = 12000;
  TestProblem test;
  std::vector<double*> cameras, points;
  for (int k = 0; k < kNumCameras; ++k) {
    cameras.push_back(test.Add(std::vector<double>(6, 1.0)));
  }
  for (int k = 0; k < kNumPoints; ++k) {
    points.push_back(test.Add(std::vector<double>(3, 1.0)));
  }
  for (int k = 0; k < 3 * kNumPoints; ++k) {
    test.problem.AddResidualBlock(
        new ShapeOnlyCost(2 + k % 5 / 4, {6, 3}), nullptr,
        {cameras[static_cast<std::size_t>(k * 7 % kNumCameras)],
         points[static_cast<std::size_t>(static_cast<std::int64_t>(k) * 4999 % kNumPoints)]});
  }
  const ProblemView view = Introspect(test.problem);
  const ShapeTable shapes = FindShapes(view);
  const GraphPlan one = PlanGraph(view, shapes, ChooseLandmarks(view, shapes));
  EXPECT_EQ(one.landmarks.num_landmarks, kNumPoints);
  ASSERT_EQ(one.families.size(), 2U);
  for (const int num_threads : {2, 5}) {
    const GraphPlan many =
        PlanGraph(view, shapes, ChooseLandmarks(view, shapes, num_threads), num_threads);
    EXPECT_EQ(many.landmarks.is_landmark, one.landmarks.is_landmark);
    EXPECT_EQ(many.blocks, one.blocks);
    ASSERT_EQ(many.families.size(), one.families.size());
    for (std::size_t k = 0; k < one.families.size(); ++k) {
      EXPECT_EQ(many.families[k].residuals, one.families[k].residuals);
      EXPECT_EQ(many.families[k].variables, one.families[k].variables);
    }
  }
}

}  // namespace
}  // namespace inceres::internal
