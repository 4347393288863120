// docs/ceres_contract.md, "Reports": those that Ceres makes of a summary.
#include <regex>

#include "conformance/support.h"
#include "support/ceres_manifolds.h"

namespace conformance {
namespace {

// Times, the version line, and digits of costs that depend on rounding replaced.
std::string WithoutNumbersOfTheMachine(std::string report) {
  report = std::regex_replace(report, std::regex("Solver Summary \\(.*\\)\n"),
                              "Solver Summary (VERSION)\n");
  report =
      std::regex_replace(report, std::regex(" +[0-9]+\\.[0-9]{6}( \\([0-9]+\\))?\n"), " TIME$1\n");
  return report;
}

TEST(Report33, BriefReport) {
  Line line;
  EXPECT_EQ(Solve(Small(), &line.problem).summary.BriefReport(),
            "Ceres Solver Report: Iterations: 3, Initial cost: 4.512500e+01, Final cost: "
            "5.012552e-16, Termination: CONVERGENCE");
  Line constant;
  constant.problem.SetParameterBlockConstant(constant.x);
  EXPECT_EQ(Solve(Small(), &constant.problem).summary.BriefReport(),
            "Ceres Solver Report: Iterations: -2, Initial cost: 4.512500e+01, Final cost: "
            "4.512500e+01, Termination: CONVERGENCE");
}

TEST(Report33, FullReport) {
  Line line;
  Options options = Small();
  options.max_num_iterations = 1;
  // From 2.2 on the library may be followed by "(Mixed Precision)", and the empty line is gone.
  const std::string library = kRelease >= 202
                                  ? "EIGEN \nTrust region strategy     LEVENBERG_MARQUARDT\n"
                                  : "EIGEN\nTrust region strategy     LEVENBERG_MARQUARDT\n\n";
  EXPECT_EQ(WithoutNumbersOfTheMachine(Solve(options, &line.problem).summary.FullReport()),
            "\n"
            "Solver Summary (VERSION)\n"
            "\n"
            "                                     Original                  Reduced\n"
            "Parameter blocks                            1                        1\n"
            "Parameters                                  1                        1\n"
            "Residual blocks                             1                        1\n"
            "Residuals                                   1                        1\n"
            "\n"
            "Minimizer                        TRUST_REGION\n"
            "\n"
            "Dense linear algebra library            " +
                library +
                "                                        Given                     Used\n"
                "Linear solver                        DENSE_QR                 DENSE_QR\n"
                "Threads                                     1                        1\n"
                "Linear solver ordering              AUTOMATIC                        1\n"
                "\n"
                "Cost:\n"
                "Initial                          4.512500e+01\n"
                "Final                            4.511598e-07\n"
                "Change                           4.512500e+01\n"
                "\n"
                "Minimizer iterations                        2\n"
                "Successful steps                            2\n"
                "Unsuccessful steps                          0\n"
                "\n"
                "Time (in seconds):\n"
                "Preprocessor TIME\n"
                "\n"
                "  Residual only evaluation TIME (1)\n"
                "  Jacobian & residual evaluation TIME (2)\n"
                "  Linear solver TIME (1)\n"
                "Minimizer TIME\n"
                "\n"
                "Postprocessor TIME\n"
                "Total TIME\n"
                "\n"
                "Termination:                   NO_CONVERGENCE (Maximum number of iterations "
                "reached. Number of iterations: 1.)\n");
}

TEST(Report33, FullReportOfASchurType) {
  Bundle bundle;
  bundle.problem.SetParameterBlockConstant(bundle.cameras[0]);
  Options options = Schur();
  options.trust_region_strategy_type = ceres::DOGLEG;
  const std::string report = Solve(options, &bundle.problem).summary.FullReport();
  EXPECT_NE(report.find("Parameters                                 42                       36\n"),
            std::string::npos);
  EXPECT_EQ(report.find("Effective parameters"), std::string::npos);
  EXPECT_NE(report.find("Trust region strategy                  DOGLEG (TRADITIONAL)"),
            std::string::npos);
  EXPECT_NE(report.find("Linear solver                     DENSE_SCHUR              DENSE_SCHUR\n"),
            std::string::npos);
  EXPECT_NE(report.find("Linear solver ordering              AUTOMATIC                      8,2\n"),
            std::string::npos);
  EXPECT_NE(report.find("Schur structure                         2,3,6                    " +
                        Specialized("2,3,6") + "\n"),
            std::string::npos);
  EXPECT_EQ(report.find("Line search steps"), std::string::npos) << report;
}

TEST(Report33, FullReportWithAManifold) {
  Rosenbrock rosenbrock;
  manifolds::Set(&rosenbrock.problem, rosenbrock.x, new manifolds::SubsetManifold(2, {1}));
  const std::string report = Solve(Small(), &rosenbrock.problem).summary.FullReport();
  EXPECT_NE(report.find("Effective parameters                        1                        1\n"),
            std::string::npos)
      << report;
}

TEST(Report33, FullReportWithBounds) {
  Line line;
  line.problem.SetParameterUpperBound(line.x, 0, 100.0);
  const std::string report = Solve(Small(), &line.problem).summary.FullReport();
  EXPECT_NE(report.find("Line search steps                           0\n"), std::string::npos)
      << report;
}

TEST(Report33, FullReportOfAFailure) {
  Line line;
  line.problem.AddResidualBlock(new Cost(1, {1}, [](auto...) { return false; }), nullptr, line.x);
  const std::string report = Solve(Small(), &line.problem).summary.FullReport();
  EXPECT_EQ(report.find("Final "), std::string::npos) << report;
  EXPECT_EQ(report.find("Change "), std::string::npos);
  EXPECT_NE(report.find(std::string("Termination:                          FAILURE (") +
                        kStartFailed + ")\n"),
            std::string::npos)
      << report;
}

TEST(Report33, IsSolutionUsable) {
  Line line;
  Options options = Small();
  EXPECT_TRUE(Solve(options, &line.problem).summary.IsSolutionUsable());
  options.max_num_iterations = 0;
  EXPECT_TRUE(Solve(options, &line.problem).summary.IsSolutionUsable());
  Callback abort([](const ceres::IterationSummary&) { return ceres::SOLVER_ABORT; });
  options.callbacks.push_back(&abort);
  EXPECT_FALSE(Solve(options, &line.problem).summary.IsSolutionUsable());
  line.x[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(Solve(options, &line.problem).summary.IsSolutionUsable());
}

// Invalid options: nothing but the message is written.
TEST(Report33, FullReportOfInvalidOptions) {
  Line line;
  Options options = Small();
  options.max_num_iterations = -1;
  const Outcome outcome = Solve(options, &line.problem);
  const std::string reason =
      "Invalid configuration. Solver::Options::max_num_iterations = -1. Violated constraint: "
      "Solver::Options::max_num_iterations >= 0";
  EXPECT_EQ(outcome.summary.message, reason);
  EXPECT_EQ(outcome.errors, std::vector<std::string>{"Terminating: " + reason});
  EXPECT_EQ(outcome.summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(outcome.summary.num_parameter_blocks, -1);
  EXPECT_EQ(outcome.summary.initial_cost, -1.0);
  EXPECT_EQ(outcome.summary.final_cost, -1.0);
  EXPECT_EQ(outcome.summary.total_time_in_seconds, -1.0);
  EXPECT_EQ(outcome.summary.num_successful_steps, -1);
  EXPECT_EQ(line.x[0], 0.5);
}

// What a summary holds from before does not show.
TEST(Report33, SummariesAreResetFirst) {
  Line line;
  Summary summary = Solve(Small(), &line.problem).summary;
  Options options = Small();
  options.max_num_iterations = -1;
  ceres::Solve(options, &line.problem, &summary);
  EXPECT_TRUE(summary.iterations.empty());
  EXPECT_EQ(summary.num_jacobian_evaluations, -1);
}

}  // namespace
}  // namespace conformance
