// SolveMode::kIncremental: the same minimum as stock Ceres, the summary, and what it hands on.
#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "adapters/ceres/fallback/gate.h"
#include "adapters/ceres/plan/option_mapping.h"
#include "adapters/ceres/session/incremental_problem.h"
#include "adapters/compare_with_stock.h"
#include "adapters/session_support.h"
#include "inceres/ceres/session.h"
#include "support/ceres_manifolds.h"

namespace inceres {
namespace {

struct Difference {  // b − a − 1
  template <typename T>
  bool operator()(const T* a, const T* b, T* r) const {
    r[0] = b[0] - a[0] - 1.0;
    return true;
  }
};

using testing::MakeBundle;
using testing::MakeCurveFit;
using testing::MakeWindow;
using testing::Recipe;
using testing::TestProblem;
using Options = ceres::Solver::Options;

Options Quiet(ceres::LinearSolverType type) {
  Options options;
  options.linear_solver_type = type;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = 200;
  return options;
}

void ExpectSameMinimum(const Recipe& recipe, ceres::LinearSolverType type) {
  const auto stock = recipe();
  const auto ours = recipe();
  // Stock's conjugate gradients do not get there.
  Options tight = Quiet(internal::IsIterative(type) ? ceres::SPARSE_NORMAL_CHOLESKY : type);
  tight.function_tolerance = tight.gradient_tolerance = tight.parameter_tolerance = 1e-14;
  ceres::Solver::Summary expected;
  ceres::Solve(tight, &stock->problem, &expected);
  ASSERT_TRUE(expected.IsSolutionUsable());
  ceres::Solver::Summary summary;
  SolveOptions asked;
  SolveReport report;
  asked.mode = SolveMode::kIncremental;
  asked.strict = true;
  Options options = Quiet(type);
  options.function_tolerance = 1e-7;  // leaves more than that undone where gains fall slowly
  inceres::Solve(options, &ours->problem, &summary, asked, &report);
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
  EXPECT_EQ(summary.message.find("Function tolerance reached. |cost_change|/cost: "), 0U)
      << summary.message;
  EXPECT_FALSE(report.update.message.empty());
  EXPECT_FALSE(report.used_stock);
  EXPECT_NEAR(summary.initial_cost, expected.initial_cost, 1e-9 * expected.initial_cost);
  EXPECT_NEAR(summary.fixed_cost, expected.fixed_cost, 1e-12 * expected.initial_cost);
  EXPECT_NEAR(summary.final_cost, expected.final_cost,
              1e-6 * expected.final_cost + 1e-12 * expected.initial_cost);
  double cost = -1.0;
  ours->problem.Evaluate(ceres::Problem::EvaluateOptions(), &cost, nullptr, nullptr, nullptr);
  EXPECT_NEAR(cost, summary.final_cost, 1e-9 * summary.final_cost + 1e-15 * expected.initial_cost);
  for (const double seconds :
       {summary.residual_evaluation_time_in_seconds, summary.jacobian_evaluation_time_in_seconds,
        summary.linear_solver_time_in_seconds}) {
    EXPECT_GT(seconds, 0.0);
  }
  EXPECT_LE(summary.residual_evaluation_time_in_seconds +
                summary.jacobian_evaluation_time_in_seconds + summary.linear_solver_time_in_seconds,
            summary.minimizer_time_in_seconds);
  EXPECT_EQ(report.changes.num_added_factors, summary.num_residual_blocks_reduced);
  EXPECT_EQ(summary.num_residual_blocks_reduced, expected.num_residual_blocks_reduced);
  EXPECT_EQ(report.num_landmarks + report.num_frames, expected.num_parameter_blocks_reduced);
  EXPECT_GT(report.update.num_iterations, 0);
  ASSERT_EQ(summary.iterations.size(), report.update.iterations.size());
  EXPECT_GT(summary.iterations.size(), 1U);
  EXPECT_EQ(summary.num_successful_steps + summary.num_unsuccessful_steps,
            static_cast<int>(summary.iterations.size()));
  EXPECT_EQ(summary.iterations[0].cost, summary.initial_cost);
  EXPECT_NEAR(summary.iterations.back().cost, summary.final_cost, 1e-9 * expected.initial_cost);
  EXPECT_GE(summary.total_time_in_seconds, summary.minimizer_time_in_seconds);
}

TEST(IncrementalMode, SameMinimumAsStock) {
  for (const ceres::LinearSolverType type :
       {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR, ceres::SPARSE_NORMAL_CHOLESKY,
        ceres::ITERATIVE_SCHUR, ceres::CGNR}) {
    SCOPED_TRACE(ceres::LinearSolverTypeToString(type));
    ExpectSameMinimum([] { return MakeBundle(5, 60, true); }, type);
    ExpectSameMinimum([] { return MakeWindow(6, 50, true); }, type);
    ExpectSameMinimum([] { return MakeWindow(6, 50, false); }, type);
    ExpectSameMinimum([] { return MakeCurveFit(0.5); }, type);
  }
}

TEST(IncrementalMode, LandmarksOfTheFirstGroup) {
  const auto test = MakeBundle(4, 30, true);
  Options options = Quiet(ceres::DENSE_SCHUR);
  options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  int num_points = 0;
  for (std::vector<double>& block : test->blocks) {
    const bool point = block.size() == 3 && num_points < 7;
    num_points += point;
    options.linear_solver_ordering->AddElementToGroup(block.data(), point ? 0 : 1);
  }
  ceres::Solver::Summary summary;
  SolveOptions asked;
  SolveReport report;
  asked.mode = SolveMode::kIncremental;
  inceres::Solve(options, &test->problem, &summary, asked, &report);
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
  EXPECT_EQ(report.num_landmarks, 7);
}

TEST(IncrementalMode, AFailureLeavesTheProblemAsItWas) {
  const auto test = MakeBundle(4, 30, true);
  test->problem.AddResidualBlock(new testing::TargetCost({1.0}, [](auto...) { return false; }),
                                 nullptr, test->Add({0.0}));
  const auto before = test->blocks;
  ceres::Solver::Summary summary;
  SolveOptions asked;
  SolveReport report;
  asked.mode = SolveMode::kIncremental;
  inceres::Solve(Quiet(ceres::DENSE_SCHUR), &test->problem, &summary, asked, &report);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_NE(summary.message.find("esidual and Jacobian evaluation failed."), std::string::npos)
      << summary.message;
  EXPECT_NE(report.core.detail.find("ceres::CostFunction"), std::string::npos)
      << report.core.detail;
  EXPECT_EQ(test->blocks, before);
}

// r = (1 − x, 10 (y − x²)) from (−1.2, 1), and a residual block of a constant, of cost 200.
struct FixedCostBeside {
  explicit FixedCostBeside(bool can_be_evaluated, ceres::LossFunction* loss = nullptr) {
    const auto rosenbrock = [=](double const* const* p, double* residuals, double** jacobians) {
      residuals[0] = 1.0 - p[0][0];
      residuals[1] = 10.0 * (p[1][0] - p[0][0] * p[0][0]);
      jacobians[0][0] = -1.0;
      jacobians[0][1] = -20.0 * p[0][0];
      jacobians[1][1] = 10.0;
      return can_be_evaluated;
    };
    test.problem.AddResidualBlock(new lambdas::Formula(2, {1, 1}, rosenbrock), loss, x,
                                  test.Add({1.0}));
    double* constant = test.Add({20.0});
    test.problem.AddResidualBlock(new testing::TargetCost({0.0}), nullptr, constant);
    test.problem.SetParameterBlockConstant(constant);
  }

  // By stock, by a session, or by inceres::Solve.
  ceres::Solver::Summary SolveBy(const std::string& who, const SolveOptions& given = {}) {
    const Options options = Quiet(ceres::DENSE_NORMAL_CHOLESKY);
    SolveOptions asked = given;
    asked.mode = SolveMode::kIncremental;
    asked.strict = true;
    ceres::Solver::Summary summary;
    if (who == "stock") {
      ceres::Solve(options, &test.problem, &summary);
    } else if (who == "a session") {
      CeresSession session{testing::AlwaysIncremental()};
      session.Solve(options, &test.problem, &summary, asked, &report);
    } else {
      inceres::Solve(options, &test.problem, &summary, asked, &report);
    }
    return summary;
  }

  TestProblem test;
  double* x = test.Add({-1.2});
  SolveReport report;
};

TEST(IncrementalMode, AStartThatCannotBeEvaluatedHasNoCost) {
  for (const bool bounded : {false, true}) {
    for (const std::string who : {"stock", "a solve", "a session"}) {
      SCOPED_TRACE(who);
      FixedCostBeside problem(/*can_be_evaluated=*/false);
      if (bounded) {
        problem.test.problem.SetParameterUpperBound(problem.x, 0, 5.0);
      }
      const ceres::Solver::Summary summary = problem.SolveBy(who);
      EXPECT_EQ(summary.termination_type, ceres::FAILURE);
      EXPECT_EQ(summary.initial_cost, -1.0);
      EXPECT_EQ(summary.final_cost, -1.0);
      EXPECT_EQ(summary.fixed_cost, 200.0);
      EXPECT_TRUE(summary.iterations.empty());
      EXPECT_EQ(problem.report.core.initial_cost, -1.0);
      EXPECT_EQ(problem.report.core.final_cost, -1.0);
    }
  }
}

TEST(IncrementalMode, WithoutMemoryForASolveThereIsNoCost) {
  FixedCostBeside problem(/*can_be_evaluated=*/true);
  SolveOptions asked;
  asked.max_memory_bytes = 1;
  const ceres::Solver::Summary summary = problem.SolveBy("a solve", asked);
  EXPECT_EQ(summary.termination_type, ceres::FAILURE);
  EXPECT_NE(summary.message.find("max_memory_bytes"), std::string::npos) << summary.message;
  EXPECT_EQ(summary.initial_cost, -1.0);
  EXPECT_EQ(summary.final_cost, -1.0);
}

// A loss of an infinite slope.
class InfiniteSlope final : public ceres::LossFunction {
 public:
  void Evaluate(double s, double rho[3]) const override {
    rho[0] = s;
    rho[1] = HUGE_VAL;
    rho[2] = 0.0;
  }
};

// A line on which no step leads anywhere.
class NoWay final : public manifolds::Manifold {
 public:
  int AmbientSize() const override { return 1; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* sum) const override {
    *sum = *x + *delta;
    return false;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    *jacobian = 1.0;
    return true;
  }
  bool Minus(const double*, const double*, double*) const override { return false; }
  bool MinusJacobian(const double*, double*) const override { return false; }
};

TEST(IncrementalMode, FailuresOfOneSolveAreInTheWordsOfCeres) {
  for (const bool invalid : {true, false}) {
    std::string messages[2];
    for (const int ours : {0, 1}) {
      FixedCostBeside problem(/*can_be_evaluated=*/true, invalid ? new InfiniteSlope : nullptr);
      if (!invalid) {
        manifolds::Set(&problem.test.problem, problem.x, new NoWay);
      }
      const auto summary = problem.SolveBy(ours == 0 ? "stock" : "a solve");
      EXPECT_EQ(summary.termination_type, ceres::FAILURE);
      messages[ours] = summary.message;
    }
    EXPECT_EQ(messages[0], messages[1]);
    EXPECT_EQ(messages[1].find("Number of consecutive invalid steps more than ") == 0, invalid);
  }
}

// What incremental steps begin and the batch solver cannot go on with ends where it began.
TEST(IncrementalMode, AFailureOfTheSecondPartOfASolveHasTheCostOfTheStart) {
  FixedCostBeside problem(/*can_be_evaluated=*/true);
  manifolds::Set(&problem.test.problem, problem.x, new NoWay);
  const ceres::Solver::Summary summary = problem.SolveBy("a session");
  EXPECT_EQ(summary.termination_type, ceres::FAILURE) << summary.message;
  EXPECT_EQ(*problem.x, -1.2);
  EXPECT_NEAR(summary.initial_cost, 212.1, 1e-9);
  EXPECT_EQ(summary.final_cost, summary.initial_cost);
}

TEST(IncrementalMode, LimitsEndInTheWordsOfCeres) {
  const auto solve = [](int max_num_iterations, double max_seconds) {
    const auto test = MakeBundle(4, 30, true);
    Options options = Quiet(ceres::DENSE_SCHUR);
    options.function_tolerance = 0.0;
    options.max_num_iterations = max_num_iterations;
    options.max_solver_time_in_seconds = max_seconds;
    ceres::Solver::Summary summary;
    SolveOptions asked;
    SolveReport report;
    asked.mode = SolveMode::kIncremental;
    inceres::Solve(options, &test->problem, &summary, asked, &report);
    EXPECT_EQ(summary.termination_type, ceres::NO_CONVERGENCE);
    return summary.message;
  };
  EXPECT_EQ(solve(2, 1e9), "Maximum number of iterations reached. Number of iterations: 2.");
  EXPECT_EQ(solve(200, 1e-9).find("Maximum solver time reached. Total solver time: "), 0U);
}

TEST(IncrementalMode, NothingToSolve) {
  const auto test = MakeBundle(4, 30, true);
  for (std::vector<double>& block : test->blocks) {
    test->problem.SetParameterBlockConstant(block.data());
  }
  ceres::Solver::Summary summary;
  SolveOptions asked;
  SolveReport report;
  asked.mode = SolveMode::kIncremental;
  inceres::Solve(Quiet(ceres::DENSE_SCHUR), &test->problem, &summary, asked, &report);
  EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
  EXPECT_EQ(summary.final_cost, summary.fixed_cost);
  EXPECT_GT(summary.fixed_cost, 0.0);
}

// What it hands on.

TEST(IncrementalGate, OptionsNoModeHonors) {
  const std::vector<std::pair<std::string, std::function<void(Options*)>>> cases = {
      {"LINE_SEARCH", [](Options* options) { options->minimizer_type = ceres::LINE_SEARCH; }},
  };
  for (const auto& [reason, set] : cases) {
    SCOPED_TRACE(reason);
    const auto test = MakeBundle(3, 20, true);
    const auto before = test->blocks;
    Options options = Quiet(ceres::DENSE_SCHUR);
    set(&options);
    ceres::Solver::Summary summary;
    SolveOptions asked;
    SolveReport report;
    asked.mode = SolveMode::kIncremental;
    asked.strict = true;
    inceres::Solve(options, &test->problem, &summary, asked, &report);
    EXPECT_EQ(summary.termination_type, ceres::FAILURE);
    EXPECT_NE(summary.message.find(reason), std::string::npos) << summary.message;
    EXPECT_EQ(test->blocks, before);
    asked.strict = false;
    inceres::Solve(options, &test->problem, &summary, asked, &report);
    EXPECT_TRUE(report.used_stock);
    EXPECT_NE(report.fallback_reason.find(reason), std::string::npos) << report.fallback_reason;
    EXPECT_LT(summary.final_cost, summary.initial_cost);
  }
}

// What only exact mode does is done exactly, trace and all, and said.
TEST(IncrementalGate, OptionsOnlyExactModeHonors) {
  const std::vector<std::pair<std::string, std::function<void(Options*, ceres::Problem*, double*)>>>
      cases = {
          {"DENSE_QR", [](Options* options, ceres::Problem*,
                          double*) { options->linear_solver_type = ceres::DENSE_QR; }},
          {"use_inner_iterations", [](Options* options, ceres::Problem*,
                                      double*) { options->use_inner_iterations = true; }},
      };
  for (const auto& [reason, set] : cases) {
    for (const bool session : {false, true}) {
      SCOPED_TRACE(reason);
      const auto test = MakeBundle(3, 20, true);
      const auto exact = MakeBundle(3, 20, true);
      Options options = Quiet(ceres::DENSE_SCHUR);
      set(&options, &test->problem, test->blocks.back().data());
      set(&options, &exact->problem, exact->blocks.back().data());
      ceres::Solver::Summary summary;
      SolveOptions asked;
      SolveReport report;
      asked.mode = SolveMode::kIncremental;
      asked.strict = true;
      testing::SolveBySessionOrOnce(session, options, &test->problem, asked, &summary, &report);
      EXPECT_FALSE(report.used_stock) << report.fallback_reason;
      EXPECT_NE(report.exact_reason.find(reason), std::string::npos) << report.exact_reason;
      ceres::Solver::Summary expected;
      inceres::Solve(options, &exact->problem, &expected);
      EXPECT_EQ(summary.iterations.size(), expected.iterations.size());
      EXPECT_EQ(summary.final_cost, expected.final_cost);
      EXPECT_EQ(test->blocks, exact->blocks);
    }
  }
}

// The first group's only block is constant: Ceres then takes DENSE_QR for DENSE_SCHUR, where we
// form normal equations, and the next group is no first group.
TEST(IncrementalMode, AFirstGroupThatIsAllConstant) {
  double held = 1.0;
  std::vector<double> x = {1.0, 2.0, 3.0};
  const auto solve = [&](ceres::LinearSolverType type, SolveReport* report) {
    ceres::Problem problem;
    const auto connect = [&problem](double* a, double* b) {
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Difference, 1, 1, 1>(new Difference),
                               nullptr, a, b);
    };
    connect(&held, &x[0]);
    connect(&x[0], &x[1]);
    connect(&x[1], &x[2]);
    problem.SetParameterBlockConstant(&held);
    Options options = Quiet(type);
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    options.linear_solver_ordering->AddElementToGroup(&held, 0);
    options.linear_solver_ordering->AddElementToGroup(&x[0], 1);
    options.linear_solver_ordering->AddElementToGroup(&x[1], 1);  // neighbors: no landmarks both
    options.linear_solver_ordering->AddElementToGroup(&x[2], 2);
    ceres::Solver::Summary summary;
    SolveOptions incremental;
    incremental.mode = SolveMode::kIncremental;
    inceres::Solve(options, &problem, &summary, incremental, report);
    return summary;
  };
  SolveReport report;
  for (const auto type : {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR}) {
    x = {3.0, 2.0, 1.0};
    const ceres::Solver::Summary summary = solve(type, &report);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE) << summary.message;
    EXPECT_EQ(report.fallback_reason, "");
    EXPECT_EQ(summary.linear_solver_type_used, type == ceres::DENSE_SCHUR
                                                   ? ceres::DENSE_NORMAL_CHOLESKY
                                                   : ceres::SPARSE_NORMAL_CHOLESKY);
    EXPECT_NEAR(x[2], 4.0, 1e-9);
  }
}

TEST(IncrementalGate, DefaultsPass) {
  EXPECT_EQ(internal::NeedsExactMode(Options(), nullptr), "");
  Options dogleg;
  dogleg.trust_region_strategy_type = ceres::DOGLEG;
  dogleg.dogleg_type = ceres::SUBSPACE_DOGLEG;
  EXPECT_EQ(internal::NeedsExactMode(dogleg, nullptr), "");
}

// Options.

TEST(IncrementalOptionMapping, TakesWhatTheUserSays) {
  Options options;
  options.max_num_iterations = 7;
  options.max_solver_time_in_seconds = 3.0;
  options.function_tolerance = 1e-3;
  options.min_relative_decrease = 0.25;
  options.initial_trust_region_radius = 100.0;
  IncrementalOptions core;
  core.truncation_share = 0.7;
  IncrementalOptions mapped = internal::MapIncrementalOptions(options, core);
  EXPECT_EQ(mapped.max_num_iterations, 7);
  EXPECT_EQ(mapped.max_solver_time_in_seconds, 3.0);
  EXPECT_EQ(mapped.function_tolerance, 1e-3);
  EXPECT_EQ(mapped.min_relative_decrease, 0.25);
  EXPECT_EQ(mapped.initial_damping, 0.01);
  EXPECT_EQ(mapped.num_threads, 1);
  EXPECT_EQ(mapped.truncation_share, 0.7);
  EXPECT_TRUE(mapped.Validate().ok());
  options.max_solver_time_in_seconds = 0.0;
  options.initial_trust_region_radius = 1e300;
  mapped = internal::MapIncrementalOptions(options, core);
  EXPECT_TRUE(mapped.Validate().ok()) << "no time and next to no damping are still valid";
  EXPECT_EQ(mapped.initial_damping, core.min_damping);
}

TEST(IncrementalOptionMapping, NamesWhatHasNoEffect) {
  const auto names = [](const Options& options) {
    return internal::IncrementalOptionsWithoutEffect(options, internal::LandmarkSelection());
  };
  EXPECT_EQ(names(Options()), std::vector<std::string>{});
  Options options;
  options.gradient_tolerance = 1e-3;
  options.parameter_tolerance = 1e-3;
  options.jacobi_scaling = false;
  options.initial_trust_region_radius = 1.0;
  EXPECT_EQ(names(options), (std::vector<std::string>{"gradient_tolerance", "parameter_tolerance",
                                                      "jacobi_scaling"}));
  options = Options();
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.initial_trust_region_radius = 1.0;
  options.max_trust_region_radius = 1e3;
  EXPECT_EQ(names(options),
            (std::vector<std::string>{"max_trust_region_radius", "initial_trust_region_radius"}));
  options = Options();
  options.dynamic_sparsity = true;
  EXPECT_EQ(names(options), std::vector<std::string>{"dynamic_sparsity"});
}

// Where the batch solver may take conjugate gradients they end by the user's options.
TEST(IncrementalOptionMapping, NamesTheEndOfConjugateGradientsUnlessTheBatchSolverMayTakeThem) {
  Options options;
  options.linear_solver_type = ceres::ITERATIVE_SCHUR;
  options.eta = 0.5;
  options.preconditioner_type = ceres::SCHUR_JACOBI;
  options.min_linear_solver_iterations = 3;
  options.max_linear_solver_iterations = 4;
  IncrementalOptions core;
  EXPECT_FALSE(internal::IteratesInBatch(options, core));
  EXPECT_EQ(internal::IncrementalOptionsWithoutEffect(options, internal::LandmarkCounts(), false),
            (std::vector<std::string>{"eta", "min_linear_solver_iterations",
                                      "max_linear_solver_iterations", "preconditioner_type"}));
  core.batch_reduced_solver = ReducedSolverKind::kAutomaticInexact;
  EXPECT_TRUE(internal::IteratesInBatch(options, core));
  EXPECT_EQ(internal::IncrementalOptionsWithoutEffect(options, internal::LandmarkCounts(), true),
            std::vector<std::string>{"preconditioner_type"});
  core.batch_share = 1.0;
  EXPECT_FALSE(internal::IteratesInBatch(options, core)) << "no batch solver";
}

// Roles.

TEST(IncrementalRoles, AreSticky) {
  using internal::PastRole;
  TestProblem test;
  double* frame = test.Add({0.0, 0.0});
  double* point = test.Add({0.0, 0.0});
  double* other = test.Add({0.0, 0.0});
  test.problem.AddResidualBlock(new testing::ShapeOnlyCost(1, {2, 2}), nullptr, frame, point);
  test.problem.AddResidualBlock(new testing::ShapeOnlyCost(1, {2, 2}), nullptr, frame, other);
  const auto roles = [&](std::vector<double*> selected, std::vector<double*> past_landmarks,
                         bool given) {
    const internal::ProblemView view = internal::Introspect(test.problem);
    internal::LandmarkSelection selection;
    selection.is_landmark.assign(3, 0);
    std::vector<PastRole> past(3, PastRole::kFrame);
    for (double* block : selected) {
      selection.is_landmark[static_cast<std::size_t>(view.index.Find(block))] = 1;
    }
    for (double* block : past_landmarks) {
      past[static_cast<std::size_t>(view.index.Find(block))] = PastRole::kLandmark;
    }
    const std::vector<Role> result = internal::ChooseIncrementalRoles(view, selection, given, past);
    std::string text;
    for (double* block : {frame, point, other}) {
      text +=
          result[static_cast<std::size_t>(view.index.Find(block))] == Role::kLandmark ? 'L' : 'F';
    }
    return text;
  };
  EXPECT_EQ(roles({point, other}, {}, false), "FLL") << "the selection";
  EXPECT_EQ(roles({}, {point}, false), "FLF") << "landmarks stay";
  EXPECT_EQ(roles({}, {point}, true), "FFF") << "but the user's word rules";
  EXPECT_EQ(roles({frame}, {point, other}, false), "LFF")
      << "where two meet, those not selected give way";
  test.problem.SetParameterBlockConstant(point);
  EXPECT_EQ(roles({frame}, {point, other}, false), "LFF")
      << "a constant gives way too: it may be variable again";
  EXPECT_EQ(roles({other}, {point}, false), "FLL") << "or else stays what it was";
  EXPECT_EQ(roles({}, {point}, true), "FLF");
}

}  // namespace
}  // namespace inceres
