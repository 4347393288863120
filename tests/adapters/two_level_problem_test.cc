// Two levels on a ceres::Problem: along streets of cameras, with points as users have them. Blocks
// that are split or shared, and gauges held otherwise, are in trust_region/two_level_test.cc. In
// incremental mode, by SolveOptions::conjugate_gradients or where ITERATIVE_SCHUR stands for what
// is predicted to take least.
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/test_problems.h"
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"
#include "support/ceres_manifolds.h"
#include "support/street_scene.h"

namespace inceres {
namespace {

using test::StreetScene;
using test::WholeView;
using testing::TestProblem;

enum class Points { kEuclidean, kInverseDepth, kHomogeneous };

struct Street {
  const char* name = "whole";
  Points points = Points::kEuclidean;
  bool held = false;  // the first camera
  int num_cameras = 60;
};

constexpr int kNumViews = 4;
constexpr int kPointsPerCamera = 12;

// The point is (x, y, z, w) on a sphere.
struct HomogeneousView {
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    const T x[3] = {point[0] / point[3], point[1] / point[3], point[2] / point[3]};
    return view(camera, x, residuals);
  }
  WholeView view;
};

// Along a ray of the host, at 1 / depth.
struct HostedView {
  template <typename T>
  bool operator()(const T* host, const T* camera, const T* inverse_depth, T* residuals) const {
    const T back[3] = {-host[0], -host[1], -host[2]};
    const T seen[3] = {ray[0] / inverse_depth[0] - host[3], ray[1] / inverse_depth[0] - host[4],
                       1.0 / inverse_depth[0] - host[5]};
    T point[3];
    test::Rotate(back, seen, point);
    return view(camera, point, residuals);
  }
  double ray[2];
  WholeView view;
};

class Builder {
 public:
  explicit Builder(const Street& street) : street_(street) {}

  std::unique_ptr<TestProblem> Build() {
    for (int i = 0; i < street_.num_cameras; ++i) {
      const std::array<double, 7> camera = scene_.NextCamera(0.002);
      cameras_.push_back(test_->Add({camera.begin(), camera.end()}));
    }
    for (int i = 0; i + kNumViews <= street_.num_cameras; ++i) {
      for (int k = 0; k < kPointsPerCamera; ++k) {
        AddPoint(i);
      }
    }
    if (street_.held) {
      problem().SetParameterBlockConstant(cameras_.front());
    }
    return std::move(test_);
  }

 private:
  ceres::Problem& problem() { return test_->problem; }

  double* AddPointBlock(const std::array<double, 3>& x) {
    if (street_.points == Points::kEuclidean) {
      return test_->Add({x[0], x[1], x[2]});
    }
    if (street_.points == Points::kInverseDepth) {
      return test_->Add({1.0 / (x[2] + scene_.random().Between(-0.1, 0.1))});
    }
    const double norm = std::sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + 1.0);
    double* const block = test_->Add({x[0] / norm, x[1] / norm, x[2] / norm, 1.0 / norm});
    problem().AddParameterBlock(block, 4);
    manifolds::Set(&problem(), block, new manifolds::SphereManifold<4>());
    return block;
  }

  void AddPoint(int first) {
    const std::array<double, 3> x = scene_.Point(first);
    double* const point = AddPointBlock(x);
    double* const host = cameras_[static_cast<std::size_t>(first)];
    for (int i = first; i < first + kNumViews; ++i) {
      const auto [u, v] = scene_.Pixel(x, i);
      double* const camera = cameras_[static_cast<std::size_t>(i)];
      if (street_.points == Points::kEuclidean) {
        problem().AddResidualBlock(
            new ceres::AutoDiffCostFunction<WholeView, 2, 7, 3>(new WholeView{u, v}), nullptr,
            camera, point);
      } else if (street_.points == Points::kHomogeneous) {
        problem().AddResidualBlock(
            new ceres::AutoDiffCostFunction<HomogeneousView, 2, 7, 4>(new HomogeneousView{{u, v}}),
            nullptr, camera, point);
      } else if (i != first) {
        auto* hosted = new HostedView{{(x[0] - first) / x[2], x[1] / x[2]}, {u, v}};
        problem().AddResidualBlock(new ceres::AutoDiffCostFunction<HostedView, 2, 7, 7, 1>(hosted),
                                   nullptr, host, camera, point);
      }
    }
  }

  const Street street_;
  StreetScene scene_;
  std::unique_ptr<TestProblem> test_ = std::make_unique<TestProblem>();
  std::vector<double*> cameras_;
};

ceres::Solver::Options StreetOptions(ceres::LinearSolverType type) {
  ceres::Solver::Options options;
  options.linear_solver_type = type;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 30;
  return options;
}

struct Solved {
  ceres::Solver::Summary summary;
  SolveReport report;
};

Solved SolveBy(PreconditionerKind preconditioner, const Street& street, int num_threads = 1) {
  const auto test = Builder(street).Build();
  SolveOptions asked;
  asked.mode = SolveMode::kIncremental;
  asked.strict = true;
  asked.conjugate_gradients.emplace();
  asked.conjugate_gradients->preconditioner = preconditioner;
  asked.conjugate_gradients->eta = 1e-3;
  asked.conjugate_gradients->max_iterations = 20000;
  ceres::Solver::Options options = StreetOptions(ceres::SPARSE_SCHUR);
  options.num_threads = num_threads;
  Solved solved;
  Solve(options, &test->problem, &solved.summary, asked, &solved.report);
  return solved;
}

class TwoLevelOnProblems : public ::testing::TestWithParam<Street> {};

TEST_P(TwoLevelOnProblems, EndsWhereAFactorizationDoesInFewIterations) {
  const auto test = Builder(GetParam()).Build();
  ceres::Solver::Options tight = StreetOptions(ceres::SPARSE_SCHUR);
  tight.function_tolerance = 1e-12;
  tight.max_num_iterations = 100;
  ceres::Solver::Summary expected;
  ceres::Solve(tight, &test->problem, &expected);
  const Solved two = SolveBy(PreconditionerKind::kTwoLevel, GetParam());
  // The last thousandths take many steps, of either.
  EXPECT_NEAR(two.summary.final_cost, expected.final_cost, 3e-3 * expected.final_cost)
      << two.summary.message;
  EXPECT_NE(two.report.update.batch_solver.find("two-level"), std::string::npos)
      << two.report.update.batch_solver;
  EXPECT_GT(two.report.update.num_pcg_iterations, two.report.update.num_iterations);
  const Solved blocks = SolveBy(PreconditionerKind::kSchurJacobi, GetParam());
  const auto per_step = [](const Solved& solved) {
    return static_cast<double>(solved.report.update.num_pcg_iterations) /
           solved.report.update.num_batch_iterations;
  };
  // By gauge modes far fewer; without them constant columns serve.
  const double share = GetParam().points == Points::kEuclidean ? 0.25 : 0.75;
  EXPECT_LT(per_step(two), share * per_step(blocks));
}

TEST_P(TwoLevelOnProblems, HasTheSameBitsForTwoThreads) {
  const Solved one = SolveBy(PreconditionerKind::kTwoLevel, GetParam());
  const Solved two = SolveBy(PreconditionerKind::kTwoLevel, GetParam(), 2);
  EXPECT_EQ(one.summary.final_cost, two.summary.final_cost);
  EXPECT_EQ(one.report.update.num_pcg_iterations, two.report.update.num_pcg_iterations);
}

INSTANTIATE_TEST_SUITE_P(Kinds, TwoLevelOnProblems,
                         ::testing::Values(Street{},
                                           Street{"inverse_depth", Points::kInverseDepth, true},
                                           Street{"homogeneous", Points::kHomogeneous}),
                         [](const ::testing::TestParamInfo<Street>& kind) {
                           return std::string(kind.param.name);
                         });

Street Long() {
  Street street;
  street.num_cameras = 250;
  return street;
}

// S of a street is sparse, and its factor cheaper than any iteration; 10,600 unknowns in all.
TEST(IterativeSchurInIncrementalMode, TakesWhatIsPredictedToTakeLeast) {
  SolveOptions asked;
  asked.mode = SolveMode::kIncremental;
  asked.strict = true;
  const auto test = Builder(Long()).Build();
  Solved solved;
  ceres::Solver::Options options = StreetOptions(ceres::ITERATIVE_SCHUR);
  options.max_num_iterations = 5;
  Solve(options, &test->problem, &solved.summary, asked, &solved.report);
  EXPECT_TRUE(solved.summary.IsSolutionUsable()) << solved.summary.message;
  EXPECT_LT(solved.summary.final_cost, 0.02 * solved.summary.initial_cost);
  EXPECT_NE(solved.report.update.batch_solver.find("Cholesky"), std::string::npos)
      << solved.report.update.batch_solver;
  EXPECT_EQ(solved.summary.linear_solver_type_used, ceres::ITERATIVE_SCHUR);
}

TEST(IterativeSchurInIncrementalMode, ASessionGoesOnFromWhatTheBatchSolverLeft) {
  const auto test = Builder(Long()).Build();
  SessionOptions session_options;
  session_options.exact_windows = false;
  CeresSession session(session_options);
  ceres::Solver::Options options = StreetOptions(ceres::ITERATIVE_SCHUR);
  options.function_tolerance = 1e-2;
  for (int round = 0; round < 2; ++round) {
    Solved solved;
    session.Solve(options, &test->problem, &solved.summary, SolveOptions(), &solved.report);
    EXPECT_EQ(solved.summary.termination_type, ceres::CONVERGENCE) << solved.summary.message;
    EXPECT_EQ(solved.report.update.num_batch_iterations > 0, round == 0);
    test->blocks[5][3] += 0.001;
  }
}

TEST(OptionsOfASolve, TooLittleMemoryIsRefusedInEitherMode) {
  for (const SolveMode mode : {SolveMode::kExact, SolveMode::kIncremental}) {
    const auto test = Builder(Street()).Build();
    const std::vector<double> before = test->blocks[7];
    SolveOptions asked;
    asked.mode = mode;
    asked.max_memory_bytes = 100000;
    Solved solved;
    Solve(StreetOptions(ceres::SPARSE_SCHUR), &test->problem, &solved.summary, asked,
          &solved.report);
    EXPECT_EQ(solved.summary.termination_type, ceres::FAILURE);
    EXPECT_FALSE(solved.report.used_stock);
    const std::string told = solved.summary.message + solved.report.core.detail;
    EXPECT_NE(told.find("max_memory_bytes is"), std::string::npos) << told;
    EXPECT_EQ(test->blocks[7], before);
  }
}

TEST(OptionsOfASolve, ConjugateGradientsOfIncrementalModeAreNamedInExactMode) {
  const auto test = Builder(Street()).Build();
  SolveOptions asked;
  asked.conjugate_gradients.emplace();
  Solved solved;
  Solve(StreetOptions(ceres::SPARSE_SCHUR), &test->problem, &solved.summary, asked, &solved.report);
  ASSERT_EQ(solved.report.options_without_effect.size(), 1U);
  EXPECT_EQ(solved.report.options_without_effect[0], "SolveOptions::conjugate_gradients");
  ceres::Solver::Options dogleg = StreetOptions(ceres::SPARSE_SCHUR);
  dogleg.trust_region_strategy_type = ceres::DOGLEG;
  asked.mode = SolveMode::kIncremental;
  Solve(dogleg, &test->problem, &solved.summary, asked, &solved.report);
  EXPECT_EQ(solved.summary.termination_type, ceres::FAILURE);
}

}  // namespace
}  // namespace inceres
