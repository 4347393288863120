// That a run is what it says it is.
#include "conformance/support.h"

namespace conformance {
namespace {

TEST(Way, SolveComesFromTheLibraryThisRunIsAbout) {
  const std::string expected = ThisRun() == Way::kBare ? "/libceres.so" : "/libinceres_dropin.so";
  EXPECT_NE(LibraryOfSolve().find(expected), std::string::npos)
      << "ceres::Solver::Solve is that of " << LibraryOfSolve();
}

TEST(Way, CostFunctionsAreCalledByWhoSolves) {
  Line line;
  const Outcome outcome = Solve(Schur(), &line.problem, Solver::kOurs);
  EXPECT_EQ(outcome.summary.termination_type, ceres::CONVERGENCE);
  // The incremental solver has no whole passes to count.
  EXPECT_EQ(outcome.summary.num_residual_evaluations == -1, ThisRun() == Way::kIncremental);
}

}  // namespace
}  // namespace conformance
