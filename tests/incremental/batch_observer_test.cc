// When the batch solver's part of an Update may be ended by a tolerance of Ceres's.

#include "incremental/batch_observer.h"

#include <atomic>

#include <gtest/gtest.h>

#include "incremental/tuning.h"
#include "incremental/update_trace.h"

namespace inceres::internal {
namespace {

// Whether a step with this radius that is short, or gains little, may end a solve.
bool MayEnd(TrustRegionStrategyKind strategy, double batch_share, double radius) {
  IncrementalOptions options;
  options.batch_strategy = strategy;
  options.batch_share = batch_share;
  const Tuning tuning;
  const std::atomic<bool> stop{false};
  const double* shown_state = nullptr;
  UpdateSummary summary;
  UpdateTrace trace(nullptr, &summary);
  FactorGraph graph;
  BatchObserver observer({&options, tuning.batch, BatchEnd::kToTheEnd, stop, /*solver=*/nullptr,
                          &graph, &shown_state, &trace});
  IterationSummary iteration;
  iteration.iteration = 1;
  iteration.model_cost_change = 1.0;
  iteration.trust_region_radius = radius;
  StepOrigin origin;
  origin.cost = 2.0;
  EXPECT_TRUE(observer.IsWorthTrying(iteration, origin));
  return observer.MayEndByTolerance();
}

TEST(BatchObserver, AStepThatIsShortForItsDampingEndsMarquardtsRuleByNoTolerance) {
  const double enough = Tuning().batch.proof_radius;
  constexpr TrustRegionStrategyKind kMarquardt = TrustRegionStrategyKind::kMarquardt;
  EXPECT_FALSE(MayEnd(kMarquardt, 0.5, 1e-6));
  EXPECT_FALSE(MayEnd(kMarquardt, 0.5, 0.99 * enough));
  EXPECT_TRUE(MayEnd(kMarquardt, 0.5, enough));
}

TEST(BatchObserver, CeresTolerancesAreKeptWhereItsStrategiesOrItsIteratesAreAskedFor) {
  EXPECT_TRUE(MayEnd(TrustRegionStrategyKind::kLevenbergMarquardt, 0.5, 1e-6));
  EXPECT_TRUE(MayEnd(TrustRegionStrategyKind::kDogleg, 0.5, 1e-6));
  EXPECT_TRUE(MayEnd(TrustRegionStrategyKind::kMarquardt, 0.0, 1e-6));
}

}  // namespace
}  // namespace inceres::internal
