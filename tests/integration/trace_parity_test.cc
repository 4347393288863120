// Whole solves next to stock Ceres, on problems on which two configurations of stock Ceres agree
// with each other.
#include <algorithm>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include <ceres/autodiff_cost_function.h>
#include <ceres/version.h>
#include <gtest/gtest.h>

#include "adapters/compare_with_stock.h"
#include "integration/problems.h"
#include "integration/runs.h"
#include "support/classic_functors.h"
#include "support/test_data.h"

namespace inceres::test {
namespace {

// Where these do not hold, a difference between two solvers says nothing about either.
// (Stock's two ways through M3500 by Dog-Leg: up to 9e-11 apart with 2.1, 4e-10 with 2.2.)
constexpr double kStockAgreesWithItself =
    100 * CERES_VERSION_MAJOR + CERES_VERSION_MINOR >= 202 ? 5e-10 : 1e-10;
constexpr double kLeastChange = 1e-9;
constexpr double kLeastThresholdDistance = 1e-5;
constexpr std::size_t kLeastIterations = 4;  // the start included

constexpr double kCostBar = 1e-9;
constexpr double kFinalCostBar = 1e-8;
constexpr double kRadiusBar = 1e-6;
constexpr double kParameterBar = 1e-6;

struct Problem {
  std::string name;
  Factory make;
  tools::LossSpec loss;  // of the robust variant
  Configuration stock;   // ours gets the same options
  Configuration other;   // stock again, rounding differently
  // of the runs with zero tolerances: as long as steps change the cost by more than rounding
  int lm_iterations;
  int dogleg_iterations;
  std::string data = {};  // of the public data sets, if it needs one
};

struct Case {
  Problem problem;
  ceres::TrustRegionStrategyType strategy;
  bool robust;
  bool zero_tolerances;
};

void PrintTo(const Case& c, std::ostream* stream) {
  *stream << c.problem.name << (c.strategy == ceres::DOGLEG ? "_Dogleg" : "_Lm")
          << (c.robust ? "_Huber" : "_Squared")
          << (c.zero_tolerances ? "_ZeroTolerances" : "_DefaultTolerances");
}

ceres::Solver::Options OptionsOf(const Case& c) {
  const int num_iterations =
      c.strategy == ceres::DOGLEG ? c.problem.dogleg_iterations : c.problem.lm_iterations;
  return c.zero_tolerances ? ZeroToleranceOptions(c.strategy, num_iterations)
                           : DefaultOptions(c.strategy);
}

// Two solves by stock Ceres that round differently, and ours.
struct Solves {
  Solved stock;
  Solved other;
  Solved ours;
};

Solves SolveByAll(const Problem& problem, const tools::LossSpec& loss,
                  const ceres::Solver::Options& options) {
  return {Solve(Who::kStock, problem.stock, options, problem.make, loss),
          Solve(Who::kStock, problem.other, options, problem.make, loss),
          Solve(Who::kInceres, problem.stock, options, problem.make, loss)};
}

void ExpectOursFollowsStock(const Solves& solves) {
  const auto& [stock, other, ours] = solves;
  const TraceDifference spread = CompareTraces(stock.summary, other.summary);
  const TraceDifference difference = CompareTraces(stock.summary, ours.summary);
  ::testing::Test::RecordProperty("stock_cost_difference", Printed(spread.cost));
  ::testing::Test::RecordProperty("cost_difference", Printed(difference.cost));
  ::testing::Test::RecordProperty("radius_difference", Printed(difference.radius));

  ASSERT_TRUE(stock.summary.IsSolutionUsable()) << stock.summary.message;
  ASSERT_GE(stock.summary.iterations.size(), kLeastIterations);
  ASSERT_EQ(stock.summary.termination_type, other.summary.termination_type);
  ASSERT_EQ(stock.summary.iterations.size(), other.summary.iterations.size());
  ASSERT_TRUE(spread.same_decisions);
  ASSERT_LE(spread.cost, kStockAgreesWithItself);
  ASSERT_GE(SmallestChange(stock.summary), kLeastChange);
  ASSERT_GE(DistanceFromThresholds(stock.summary), kLeastThresholdDistance);

  EXPECT_EQ(stock.summary.termination_type, ours.summary.termination_type) << ours.summary.message;
  EXPECT_NEAR(static_cast<double>(stock.summary.iterations.size()),
              static_cast<double>(ours.summary.iterations.size()), 1.0);
  EXPECT_TRUE(difference.same_decisions);
  EXPECT_LE(difference.cost, kCostBar);
  EXPECT_LE(difference.radius, kRadiusBar);
  EXPECT_LE(RelativeDifference(stock.summary.final_cost, ours.summary.final_cost), kFinalCostBar);
  EXPECT_LE(LargestDifference(stock.x, ours.x), kParameterBar);
  if (stock.summary.iterations.size() == ours.summary.iterations.size()) {
    testing::ExpectSameCounts(stock.summary, ours.summary);
  }
}

class TraceParity : public ::testing::TestWithParam<Case> {};

TEST_P(TraceParity, FollowsStock) {
  const Case& c = GetParam();
  if (!c.problem.data.empty() && FindData(c.problem.data).empty()) {
    GTEST_SKIP() << MissingData(c.problem.data);
  }
  ExpectOursFollowsStock(
      SolveByAll(c.problem, c.robust ? c.problem.loss : tools::LossSpec(), OptionsOf(c)));
}

const char kStreet[] = "street-16-1200-pre.txt";
const char kLoop[] = "loop-24-1800-pre.txt.gz";

const Configuration kDenseSchur{ceres::DENSE_SCHUR};
const Configuration kSparseSchur{ceres::SPARSE_SCHUR};
const Configuration kDenseSchurLandmarksFirst{ceres::DENSE_SCHUR, true};
const Configuration kSparseSchurLandmarksFirst{ceres::SPARSE_SCHUR, true};

Factory StreetFactory(Gauge gauge) {
  return [gauge](const tools::LossSpec& loss) {
    return MakeBal(SmallStreet(3, 3.0), tools::BalCameraModel::kAngleAxis, gauge, loss);
  };
}

Factory BundledFactory(const std::string& file, Gauge gauge) {
  return [file, gauge](const tools::LossSpec& loss) {
    return MakeBal(BundledBal(file), tools::BalCameraModel::kAngleAxis, gauge, loss);
  };
}

Factory HomogeneousFactory(Gauge gauge) {
  return [gauge](const tools::LossSpec& loss) {
    return MakeHomogeneous(SmallStreet(5, 1.0), gauge, loss);
  };
}

Factory InverseDepthFactory(PoseUpdate update) {
  return [update](const tools::LossSpec& loss) { return MakeInverseDepth(update, loss); };
}

Problem PoseGraphProblem(const std::string& name, const std::string& file, int lm_iterations,
                         int dogleg_iterations) {
  const Configuration automatic{ceres::SPARSE_NORMAL_CHOLESKY};
  const auto make = [file](const tools::LossSpec& loss) {
    return MakePoseGraph(FindData(file), loss);
  };
  return {name, make, Huber(2.0), automatic, kSparseSchur, lm_iterations, dogleg_iterations, file};
}

// Both strategies, with and without Huber, with default and with zero tolerances.
std::vector<Problem> WellConditioned() {
  const Configuration dense_qr{ceres::DENSE_QR};
  const Configuration lapack_qr{ceres::DENSE_QR, false, ceres::LAPACK};
  const Gauge held = Gauge::kTwoCamerasConstant;
  return {
      {"GeneratedStreet", StreetFactory(held), Huber(1.0), kDenseSchur, kSparseSchurLandmarksFirst,
       5, 4},
      {"BundledStreet", BundledFactory(kStreet, held), Huber(1.0), kSparseSchur,
       kDenseSchurLandmarksFirst, 5, 4},
      {"BundledLoop", BundledFactory(kLoop, held), Huber(1.0), kDenseSchurLandmarksFirst,
       kSparseSchur, 5, 5},
      {"InverseDepthManifold", InverseDepthFactory(PoseUpdate::kManifold), Huber(1.0), kDenseSchur,
       kSparseSchurLandmarksFirst, 5, 4},
      {"InverseDepthLocalParameterization", InverseDepthFactory(PoseUpdate::kLocalParameterization),
       Huber(1.0), kDenseSchur, kSparseSchurLandmarksFirst, 5, 4},
      {"Homogeneous", HomogeneousFactory(held), Huber(1.0), kSparseSchur, kDenseSchurLandmarksFirst,
       5, 3},
      PoseGraphProblem("M3500", "pose_graph/M3500.g2o", 12, 6),
      {"Powell", MakePowell, Huber(1.0), dense_qr, lapack_qr, 12, 12},
      {"CurveFit", MakeCurveFit, Huber(0.5), dense_qr, lapack_qr, 12, 12},
  };
}

// With their seven freedoms: for Levenberg-Marquardt only.
std::vector<Problem> GaugeFree() {
  const Gauge free = Gauge::kFree;
  return {
      {"FreeGeneratedStreet", StreetFactory(free), Huber(1.0), kDenseSchur,
       kSparseSchurLandmarksFirst, 5, 0},
      {"FreeBundledStreet", BundledFactory(kStreet, free), Huber(1.0), kSparseSchur,
       kDenseSchurLandmarksFirst, 5, 0},
      {"FreeBundledLoop", BundledFactory(kLoop, free), Huber(1.0), kDenseSchurLandmarksFirst,
       kSparseSchur, 5, 0},
      {"FreeHomogeneous", HomogeneousFactory(free), Huber(1.0), kSparseSchur,
       kDenseSchurLandmarksFirst, 5, 0},
  };
}

std::vector<Case> Cases() {
  std::vector<Case> cases;
  // Tolerances are zero with the loss for one strategy, without it for the other.
  for (const bool robust : {false, true}) {
    for (const Problem& problem : WellConditioned()) {
      cases.push_back({problem, ceres::LEVENBERG_MARQUARDT, robust, robust});
      cases.push_back({problem, ceres::DOGLEG, robust, !robust});
    }
    for (const Problem& problem : GaugeFree()) {
      cases.push_back({problem, ceres::LEVENBERG_MARQUARDT, robust, robust});
    }
  }
  // Large. Dog-Leg from the start of the file is a matter for lockstep: stock Ceres differs from
  // itself by 2e-9.
  const Problem sphere = PoseGraphProblem("Sphere", "pose_graph/sphere.g2o", 5, 0);
  cases.push_back({sphere, ceres::LEVENBERG_MARQUARDT, false, false});
  cases.push_back({sphere, ceres::LEVENBERG_MARQUARDT, true, true});
  return cases;
}

// Between the clamps the Jacobi scale cancels out of the damping; only where they bite does it show
// that it is frozen at the start.
class ClampedDamping : public ::testing::TestWithParam<bool> {};

TEST_P(ClampedDamping, FollowsStock) {
  for (const bool dogleg : {false, true}) {
    SCOPED_TRACE(dogleg ? "Dog-Leg" : "Levenberg-Marquardt");
    // A radius within which the steps hang on the damping.
    const Problem street = WellConditioned().front();
    ceres::Solver::Options options =
        ZeroToleranceOptions(dogleg ? ceres::DOGLEG : ceres::LEVENBERG_MARQUARDT, 6);
    options.initial_trust_region_radius = 10.0;
    options.jacobi_scaling = GetParam();
    const Solved unclamped =
        Solve(Who::kInceres, street.stock, options, street.make, tools::LossSpec());
    options.min_lm_diagonal = options.jacobi_scaling ? 0.5 : 1e3;
    options.max_lm_diagonal = options.jacobi_scaling ? 0.9 : 1e5;
    const Solves clamped = SolveByAll(street, tools::LossSpec(), options);
    EXPECT_GT(CompareTraces(unclamped.summary, clamped.ours.summary).cost, 1e-3)
        << "the clamps do nothing here";
    ExpectOursFollowsStock(clamped);
  }
}

INSTANTIATE_TEST_SUITE_P(Exact, ClampedDamping, ::testing::Bool(),
                         ::testing::PrintToStringParamName());

std::unique_ptr<Instance> MakeRosenbrock(const tools::LossSpec& /*loss*/) {
  auto instance = std::make_unique<Instance>();
  instance->x = {-1.2, 1.0};
  instance->problem = std::make_unique<ceres::Problem>();
  instance->problem->AddResidualBlock(
      new ceres::AutoDiffCostFunction<RosenbrockTerm, 2, 2>(new RosenbrockTerm), nullptr,
      instance->x.data());
  return instance;
}

// In a valley that bends, where some steps raise the cost and others are rejected.
TEST(NonmonotonicSteps, FollowStock) {
  const Configuration dense_qr{ceres::DENSE_QR};
  const Configuration lapack_qr{ceres::DENSE_QR, false, ceres::LAPACK};
  const Problem rosenbrock{"Rosenbrock", MakeRosenbrock, {}, dense_qr, lapack_qr, 12, 12};
  for (const bool dogleg : {false, true}) {
    SCOPED_TRACE(dogleg ? "Dog-Leg" : "Levenberg-Marquardt");
    ceres::Solver::Options options =
        ZeroToleranceOptions(dogleg ? ceres::DOGLEG : ceres::LEVENBERG_MARQUARDT, 12);
    options.initial_trust_region_radius = 1.0;
    options.use_nonmonotonic_steps = true;
    const Solves solves = SolveByAll(rosenbrock, tools::LossSpec(), options);
    const auto& steps = solves.stock.summary.iterations;
    EXPECT_GT(std::count_if(steps.begin(), steps.end(),
                            [](const auto& step) { return step.step_is_nonmonotonic; }),
              1);
    EXPECT_GT(solves.stock.summary.num_unsuccessful_steps, 1);
    ExpectOursFollowsStock(solves);
  }
}

INSTANTIATE_TEST_SUITE_P(Exact, TraceParity, ::testing::ValuesIn(Cases()),
                         ::testing::PrintToStringParamName());

}  // namespace
}  // namespace inceres::test
