// When steps by Marquardt's rule that gain little are an end.

#include "incremental/stagnation.h"

#include <algorithm>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

constexpr double kLittle = 1e-6;  // T, the tolerance

struct Walk {
  Stagnation::Verdict verdict = Stagnation::Verdict::kGoOn;
  double restart_radius = 0.0;
};

// Whole steps with this radius, of which the first gains so many tolerances, and each later one
// `growth` times as much as the one before it; sixty at most.
Walk Take(double radius, double gain, double growth) {
  const Tuning::Batch tuning;
  Stagnation stagnation(tuning);
  double cost = 1.0;
  stagnation.Begin(cost);
  IterationSummary iteration;
  iteration.step_is_successful = true;
  iteration.trust_region_radius = radius;
  Walk walk;
  for (int i = 0; i < 60 && walk.verdict == Stagnation::Verdict::kGoOn; ++i) {
    iteration.cost_change = gain * kLittle;
    cost -= iteration.cost_change;
    walk.verdict = stagnation.After(iteration, cost, kLittle, radius);
    walk.restart_radius = std::max(walk.restart_radius, stagnation.TakeRestartRadius());
    gain *= growth;
  }
  return walk;
}

TEST(Stagnation, IsProvenByStepsWithLittleDampingOnly) {
  const double proof_radius = Tuning::Batch().proof_radius;
  for (const double radius : {1e-5, 0.1 * proof_radius, proof_radius, 1e8}) {
    const Walk walk = Take(radius, 0.01, 1.0);
    EXPECT_EQ(walk.verdict, radius >= proof_radius ? Stagnation::Verdict::kProven
                                                   : Stagnation::Verdict::kUnproven)
        << radius;
    EXPECT_EQ(walk.restart_radius, proof_radius);
  }
}

// Whole steps that are hardly damped go down a flat valley as far as the model wants. So they do
// where a saddle is left, until gains are large.
TEST(Stagnation, HalfAToleranceAStepIsAnEndUnlessGainsGrow) {
  EXPECT_EQ(Take(1e8, 0.45, 1.0).verdict, Stagnation::Verdict::kProven);
  EXPECT_EQ(Take(1e8, 0.45, 0.95).verdict, Stagnation::Verdict::kProven);
  EXPECT_EQ(Take(1e8, 0.28, 1.05).verdict, Stagnation::Verdict::kGoOn);
  EXPECT_EQ(Take(1e8, 0.12, 1.2).verdict, Stagnation::Verdict::kGoOn);
}

TEST(Stagnation, NextToNothingIsAnEndThoughItGrows) {
  EXPECT_EQ(Take(1e8, 0.001, 1.01).verdict, Stagnation::Verdict::kProven);
}

// All lengths of steps refused, where the gradient promises so many tolerances times the radius;
// the radii to begin anew from go to `restarts`. The number of steps.
int StepsAtBorder(double tolerances, std::vector<double>* restarts) {
  const Tuning::Batch tuning;
  Stagnation stagnation(tuning);
  stagnation.Begin(1.0);
  IterationSummary refused;
  refused.cost = std::numeric_limits<double>::max();
  double radius = tuning.proof_radius;
  Stagnation::Verdict verdict = Stagnation::Verdict::kGoOn;
  int num_steps = 0;
  for (; num_steps < 50 && verdict == Stagnation::Verdict::kGoOn; ++num_steps) {
    refused.trust_region_radius = 1e-2 * radius;
    refused.model_cost_change = tolerances * kLittle * radius;
    verdict = stagnation.After(refused, 1.0, kLittle, radius);
    const double restart = stagnation.TakeRestartRadius();
    radius = restart > 0.0 ? restart : refused.trust_region_radius;
    if (restart > 0.0) {
      restarts->push_back(restart);
    }
  }
  EXPECT_EQ(verdict, Stagnation::Verdict::kRefusals);
  return num_steps;
}

// At a border every second decade of the damping is passed over: those are tried before the end.
TEST(Stagnation, AtABorderEndsAfterTwoLaddersOfDampings) {
  const std::vector<double> once{0.1 * Tuning::Batch().proof_radius};
  std::vector<double> restarts;
  // From 1e4 and from 1e3 down to 1e-8.
  EXPECT_EQ(StepsAtBorder(1e9, &restarts), 13);
  EXPECT_EQ(restarts, once);
  // Until they promise a thousandth of the tolerance: with 1e-4, and with 1e-3.
  restarts.clear();
  EXPECT_EQ(StepsAtBorder(1.0, &restarts), 9);
  EXPECT_EQ(restarts, once);
}

// One step with next to no damping, and lengths from some other one on, are not all of them.
TEST(Stagnation, AtABorderOneStepWithLittleDampingIsNoLadder) {
  const Tuning::Batch tuning;
  Stagnation stagnation(tuning);
  stagnation.BeginAtBorder(1.0, /*refused=*/true);
  EXPECT_EQ(stagnation.TakeRestartRadius(), tuning.proof_radius);
  IterationSummary refused;
  refused.cost = std::numeric_limits<double>::max();
  refused.model_cost_change = 1.0;
  Stagnation::Verdict verdict = Stagnation::Verdict::kGoOn;
  for (const double radius : {1e8, 1e-4, 1e-6}) {
    refused.trust_region_radius = 1e-2 * radius;
    verdict = stagnation.After(refused, 1.0, kLittle, radius);
  }
  EXPECT_NE(verdict, Stagnation::Verdict::kRefusals);
}

// Each length of a step gains a little before the border cuts it, and all of them together less
// than the tolerance: that goes on, and proves nothing.
TEST(Stagnation, CreepingAlongABorderEndsWithoutAProof) {
  const Tuning::Batch tuning;
  Stagnation stagnation(tuning);
  double cost = 1.0;
  stagnation.Begin(cost);
  IterationSummary cut;
  cut.step_is_successful = true;
  cut.step_share = 1e-6;
  cut.cost_change = 0.1 * kLittle;
  double radius = tuning.proof_radius;
  Stagnation::Verdict verdict = Stagnation::Verdict::kGoOn;
  int num_iterations = 0;
  for (; num_iterations < 100 && verdict == Stagnation::Verdict::kGoOn; ++num_iterations) {
    cost -= cut.cost_change;
    cut.trust_region_radius = 1e-2 * radius;
    verdict = stagnation.After(cut, cost, kLittle, radius);
    const double restart = stagnation.TakeRestartRadius();
    radius = restart > 0.0 ? restart : cut.trust_region_radius;
  }
  EXPECT_EQ(verdict, Stagnation::Verdict::kUnproven);
  EXPECT_LT(num_iterations, 20);
  EXPECT_NE(stagnation.InWords(verdict, cost).find("creep"), std::string::npos);
}

}  // namespace
}  // namespace inceres::internal
