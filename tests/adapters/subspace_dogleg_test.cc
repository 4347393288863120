// SUBSPACE_DOGLEG in exact mode next to stock Ceres.
#include <string>
#include <tuple>

#include <gtest/gtest.h>

#include "adapters/compare_with_stock.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::SolveBoth;
using testing::TestProblem;
using Options = ceres::Solver::Options;

struct DoglegCase {
  const char* name;
  std::function<std::unique_ptr<TestProblem>()> recipe;
  ceres::LinearSolverType linear_solver;
  double radius;
};

// One unknown: gradient and Gauss–Newton step are parallel, the plane is a line.
struct Cosine {
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    residual[0] = exp(x[0]) - 20.0;
    return true;
  }
};

std::unique_ptr<TestProblem> MakeLine() {
  auto test = std::make_unique<TestProblem>();
  test->problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Cosine, 1, 1>(new Cosine), nullptr,
                                 test->Add({0.0}));
  return test;
}

Options SubspaceOptions(const DoglegCase& which) {
  Options options;
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.dogleg_type = ceres::SUBSPACE_DOGLEG;
  options.linear_solver_type = which.linear_solver;
  options.initial_trust_region_radius = which.radius;
  options.max_num_iterations = 25;
  return options;
}

class SubspaceDogleg : public ::testing::TestWithParam<std::tuple<DoglegCase, bool, bool>> {};

TEST_P(SubspaceDogleg, FollowsStock) {
  const auto& [which, nonmonotonic, jacobi_scaling] = GetParam();
  Options options = SubspaceOptions(which);
  options.use_nonmonotonic_steps = nonmonotonic;
  options.jacobi_scaling = jacobi_scaling;
  const BothSolved both = SolveBoth(which.recipe, options);
  ExpectSameSummary(both, 1e-6, false);
  ExpectSameParameters(both, 1e-6);
  EXPECT_EQ(both.report.options_without_effect, std::vector<std::string>{});
}

INSTANTIATE_TEST_SUITE_P(
    Problems, SubspaceDogleg,
    ::testing::Combine(
        ::testing::Values(DoglegCase{"Line", MakeLine, ceres::DENSE_QR, 0.1},
                          DoglegCase{"Powell", testing::MakePowell, ceres::DENSE_QR, 0.5},
                          DoglegCase{"Curve", [] { return testing::MakeCurveFit(1.0); },
                                     ceres::DENSE_QR, 0.2},
                          DoglegCase{"CurveNormal", [] { return testing::MakeCurveFit(0.0); },
                                     ceres::DENSE_NORMAL_CHOLESKY, 1e4},
                          DoglegCase{"Bundle", [] { return testing::MakeBundle(4, 25, true); },
                                     ceres::DENSE_SCHUR, 0.3},
                          DoglegCase{"Window", [] { return testing::MakeWindow(5, 25, true); },
                                     ceres::SPARSE_SCHUR, 0.5}),
        ::testing::Bool(), ::testing::Bool()),
    [](const ::testing::TestParamInfo<std::tuple<DoglegCase, bool, bool>>& instance) {
      return std::string(std::get<0>(instance.param).name) +
             (std::get<1>(instance.param) ? "Nonmonotonic" : "") +
             (std::get<2>(instance.param) ? "" : "Unscaled");
    });

// It is another path than the traditional one, and the boundary is met.
TEST(SubspaceDoglegDetails, DiffersFromTheTraditionalPath) {
  Options options = SubspaceOptions({"", nullptr, ceres::DENSE_QR, 0.5});
  const BothSolved subspace = SolveBoth(testing::MakePowell, options);
  options.dogleg_type = ceres::TRADITIONAL_DOGLEG;
  const BothSolved traditional = SolveBoth(testing::MakePowell, options);
  ASSERT_GT(subspace.ours.iterations.size(), 2U);
  EXPECT_NE(subspace.ours.iterations[1].cost, traditional.ours.iterations[1].cost);
}

}  // namespace
}  // namespace inceres
