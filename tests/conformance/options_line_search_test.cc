// docs/ceres_contract.md, "Minimizer and line search options". Test names are the fields'. Those of
// the search along a step for bounds are next to stock in adapters/bounds_test.cc.
#include "conformance/support.h"

namespace conformance {
namespace {

TEST(Options21, minimizer_type) {
  for (const auto type : {ceres::TRUST_REGION, ceres::LINE_SEARCH}) {
    Line line;
    Options options = Small();
    options.minimizer_type = type;
    const Solver solver = type == ceres::TRUST_REGION ? Solver::kOurs : Solver::kAnyone;
    const Summary summary = Solve(options, &line.problem, solver).summary;
    EXPECT_EQ(summary.minimizer_type, type);
    EXPECT_EQ(summary.termination_type, ceres::CONVERGENCE);
    EXPECT_NEAR(line.x[0], 10.0, 1e-6);
  }
}

// Validated whatever the minimizer: (L)BFGS requires WOLFE.
TEST(Options21, line_search_type) {
  Line line;
  Options options = Small();
  options.line_search_type = ceres::ARMIJO;
  const Outcome outcome = Solve(options, &line.problem);
  EXPECT_EQ(outcome.summary.termination_type, ceres::FAILURE);
  EXPECT_EQ(line.x[0], 0.5);
}

}  // namespace
}  // namespace conformance
