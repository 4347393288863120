// The thresholds of a new incremental solver are what was set before.

#include "incremental/tuning.h"

#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "incremental/incremental_bundle.h"

namespace inceres::internal {
namespace {

TEST(Tuning, IsTakenByTheNextSolver) {
  const auto evaluations = [] {
    IncrementalOptions options;
    options.batch_share = 1.0;
    test::IncrementalBundle bundle(options);
    bundle.Grow(10, 60, 3);
    return bundle.solver.Update().num_evaluated_factors;
  };
  const auto usual = evaluations();
  TuningOfNewSolvers().stop.share = 1e-6;
  const auto strict = evaluations();
  TuningOfNewSolvers() = Tuning();
  EXPECT_GT(strict, usual);
  EXPECT_EQ(evaluations(), usual);
}

}  // namespace
}  // namespace inceres::internal
