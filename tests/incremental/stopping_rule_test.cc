// When an Update has found its minimum: what landmarks creep toward is looked at before it is
// claimed.

#include "incremental/stopping_rule.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "incremental/landmark_searches.h"

namespace inceres::internal {
namespace {

constexpr double kCost = 100.0;
constexpr double kTolerance = 1e-4;  // T
constexpr int kLandmark = 0;

StoppingRule RuleAfterAStep() {
  StoppingRule rule(Tuning::Stop(), kTolerance / kCost, 0.0, 0.0, 0, kCost);
  // It gained what it promised, and no more than T / 2, so that it bears claims out.
  rule.StepTaken(0.4 * kTolerance, 0.4 * kTolerance, 1.0);
  return rule;
}

bool IsLittle(StoppingRule* rule, double remaining, double landmark_gain) {
  return rule->IsLittleLeft(remaining * kTolerance, landmark_gain * kTolerance, kCost, 1, false);
}

// A first claim that no step bears out has to wait for one.
TEST(StoppingRule, AStepThatMissesItsPromiseBearsNothingOut) {
  for (const double gain_ratio : {0.2, 0.6, 1.9, 2.5}) {
    StoppingRule rule(Tuning::Stop(), kTolerance / kCost, 0.0, 0.0, 0, kCost);
    rule.StepTaken(0.1 * kTolerance, 0.1 * gain_ratio * kTolerance, gain_ratio);
    EXPECT_TRUE(IsLittle(&rule, 0.05, 0.0));
    EXPECT_EQ(rule.WaitForStep(), gain_ratio < 0.5 || gain_ratio > 2.0) << gain_ratio;
  }
}

// Promises that fall fast bear a claim out, but not where the cost has curved downward on the way:
// of the direction that did so little may be left for now.
TEST(StoppingRule, WhereTheCostHasCurvedDownwardASmallStepBearsOut) {
  for (const double gain_ratio : {1.5, 2.5}) {
    StoppingRule rule(Tuning::Stop(), kTolerance / kCost, 0.0, 0.0, 0, kCost);
    rule.StepTaken(1e4 * kTolerance, 1e4 * gain_ratio * kTolerance, gain_ratio);
    rule.StepTaken(10.0 * kTolerance, 10.0 * kTolerance, 1.0);
    EXPECT_TRUE(IsLittle(&rule, 0.05, 0.0));
    EXPECT_EQ(rule.WaitForStep(), gain_ratio > 2.0);
    rule.StepTaken(0.05 * kTolerance, 0.05 * kTolerance, 1.0);
    EXPECT_TRUE(IsLittle(&rule, 1e-4, 0.0));
    EXPECT_FALSE(rule.WaitForStep());
  }
}

// Steps that keep their promises, each promising a hundredth of the one before, leave old Jacobians
// their say; what has fallen slowly, or been wrong, does not.
TEST(StoppingRule, AfterWrongOrSlowStepsOldJacobiansSayLess) {
  for (const double gain_ratio : {0.4, 1.0, 1.6}) {
    for (const double second : {1.0, 60.0}) {
      StoppingRule rule(Tuning::Stop(), kTolerance / kCost, 0.0, 0.0, 0, kCost);
      rule.StepTaken(100.0 * kTolerance, 100.0 * gain_ratio * kTolerance, gain_ratio);
      rule.StepTaken(second * kTolerance, second * kTolerance, 1.0);
      EXPECT_EQ(rule.WasOff(), gain_ratio != 1.0 || second > 50.0) << gain_ratio << " " << second;
    }
  }
  StoppingRule rule(Tuning::Stop(), kTolerance / kCost, 0.0, 0.0, 0, kCost);
  EXPECT_FALSE(rule.WasOff());
  rule.StepRefused();
  EXPECT_TRUE(rule.WasOff());
}

// A step that promised more than the one before had come to another direction, of which nothing is
// known but that.
TEST(StoppingRule, PromisesThatHaveRisenDoNotFallSteadily) {
  for (const double before : {10.0, 1000.0}) {
    StoppingRule rule(Tuning::Stop(), kTolerance / kCost, 0.0, 0.0, 0, kCost);
    rule.StepTaken(before * kTolerance, before * kTolerance, 1.0);
    rule.StepTaken(20.0 * kTolerance, 20.0 * kTolerance, 1.0);
    EXPECT_TRUE(IsLittle(&rule, 0.05, 0.0));
    EXPECT_EQ(rule.WaitForStep(), before < 20.0);
  }
}

// However little the step before gained.
TEST(StoppingRule, WhatHasRisenWithTheLastStepIsNotBorneOut) {
  for (const double remaining : {0.02, 0.07}) {
    StoppingRule rule(Tuning::Stop(), kTolerance / kCost, 0.0, 0.0, 0, kCost);
    rule.StepTaken(0.05 * kTolerance, 0.05 * kTolerance, 1.0);
    EXPECT_TRUE(IsLittle(&rule, remaining, 0.0));
    EXPECT_EQ(rule.WaitForStep(), remaining > 0.05);
  }
}

TEST(StoppingRule, LandmarksThatMayCreepAreAskedFirst) {
  StoppingRule rule = RuleAfterAStep();
  EXPECT_FALSE(IsLittle(&rule, 0.07, 0.05));
  EXPECT_TRUE(rule.waits_for_landmarks());
  rule.LandmarksStepped(0.0, 0.0, 0.0);
  EXPECT_TRUE(IsLittle(&rule, 0.05, 0.02));
  EXPECT_FALSE(rule.waits_for_landmarks());
}

TEST(StoppingRule, WhatTheyHaveLeftCounts) {
  StoppingRule rule = RuleAfterAStep();
  rule.LandmarksStepped(0.0, kTolerance, 0.0);
  EXPECT_FALSE(IsLittle(&rule, 0.01, 0.001));
  EXPECT_TRUE(rule.waits_for_landmarks());
  EXPECT_FALSE(rule.waits_for_unasked());
  rule.LandmarksStepped(0.0, std::numeric_limits<double>::infinity(), 0.0);
  EXPECT_FALSE(IsLittle(&rule, 0.01, 0.001));
  rule.LandmarksStepped(0.0, 0.1 * kTolerance, 0.0);
  EXPECT_TRUE(IsLittle(&rule, 0.01, 0.001));
}

TEST(StoppingRule, LandmarksThatWereNotAskedMayCreep) {
  StoppingRule rule = RuleAfterAStep();
  rule.LandmarksStepped(0.0, 0.0, 0.05 * kTolerance);
  EXPECT_FALSE(IsLittle(&rule, 0.07, 0.05));
  EXPECT_TRUE(rule.waits_for_unasked());
  rule.LandmarksStepped(0.0, 0.0, 0.01 * kTolerance);
  EXPECT_TRUE(IsLittle(&rule, 0.07, 0.05));
}

TEST(StoppingRule, AStepOfTheFramesMakesThemUnknownAgain) {
  StoppingRule rule = RuleAfterAStep();
  rule.LandmarksStepped(0.0, 0.0, 0.0);
  EXPECT_TRUE(IsLittle(&rule, 0.07, 0.05));
  rule.StepTaken(0.4 * kTolerance, 0.4 * kTolerance, 1.0);
  EXPECT_FALSE(IsLittle(&rule, 0.07, 0.05));
}

TEST(StoppingRule, WhereLandmarksHaveCreptFarTheFramesFollow) {
  StoppingRule rule = RuleAfterAStep();
  rule.LandmarksStepped(0.6 * kTolerance, 0.0, 0.0);
  EXPECT_TRUE(IsLittle(&rule, 0.05, 0.001)) << "they have not crept";
  rule.LandmarksStepped(0.0, kTolerance, 0.0);
  EXPECT_FALSE(IsLittle(&rule, 0.05, 0.001));
  EXPECT_TRUE(rule.waits_for_landmarks());
  rule.LandmarksStepped(0.0, 0.0, 0.0);
  EXPECT_FALSE(IsLittle(&rule, 0.05, 0.001)) << "they have nothing left, but the frames may";
  EXPECT_FALSE(rule.waits_for_landmarks());
  rule.StepTaken(0.05 * kTolerance, 0.05 * kTolerance, 1.0);
  rule.LandmarksStepped(0.0, 0.0, 0.0);
  EXPECT_TRUE(IsLittle(&rule, 0.01, 0.001));
}

TEST(StoppingRule, LandmarksThatPromiseNothingNeedNotBeAsked) {
  StoppingRule rule = RuleAfterAStep();
  EXPECT_FALSE(IsLittle(&rule, 0.05, 0.002));
  EXPECT_TRUE(IsLittle(&rule, 0.05, 0.0005));
  Tuning::Stop never;
  never.landmarks_share = HUGE_VAL;
  rule = StoppingRule(never, kTolerance / kCost, 0.0, 0.0, 0, kCost);
  EXPECT_TRUE(IsLittle(&rule, 0.05, 0.02));
  EXPECT_FALSE(IsLittle(&rule, 0.05, 0.05));
}

TEST(StoppingRule, ARefusedStepProvesNothingWhereLandmarksCreep) {
  StoppingRule rule = RuleAfterAStep();
  EXPECT_TRUE(rule.IsVain(0.01 * kTolerance, -1e-9 * kCost, kCost));
  rule.LandmarksStepped(0.0, kTolerance, 0.0);
  EXPECT_FALSE(IsLittle(&rule, 0.01, 0.001));
  EXPECT_FALSE(rule.IsVain(0.01 * kTolerance, -1e-9 * kCost, kCost));
  EXPECT_TRUE(rule.IsVain(0.01 * kTolerance, 0.0, kCost)) << "nothing changes the cost";
}

// Its model was wrong there, and a step that gained much says nothing of what else is left.
TEST(StoppingRule, ARefusedStepProvesNothingBeforeOneThatBearsItOut) {
  for (const double gain : {0.4, 3.0}) {
    StoppingRule rule(Tuning::Stop(), kTolerance / kCost, 0.0, 0.0, 0, kCost);
    rule.StepTaken(gain * kTolerance, gain * kTolerance, 1.0);
    EXPECT_EQ(rule.IsVain(0.3 * kTolerance, -0.5 * kTolerance, kCost), gain < 0.5);
  }
}

TEST(StoppingRule, StepsThatWereDampedHardDoNotStagnate) {
  StoppingRule rule(Tuning::Stop(), kTolerance / kCost, 0.0, 0.0, 0, kCost);
  const auto is_little_at = [&rule](int iteration) {
    return rule.IsLittleLeft(0.9 * kTolerance, 0.0, kCost, iteration, false);
  };
  EXPECT_FALSE(is_little_at(9));
  rule.CountStepsFrom(9, kCost);
  EXPECT_FALSE(is_little_at(10));
  EXPECT_TRUE(is_little_at(19));
}

TEST(StoppingRule, WaitsForNoLandmarkWhereTheFramesHaveMuchLeft) {
  StoppingRule rule = RuleAfterAStep();
  EXPECT_FALSE(IsLittle(&rule, 3.0, 0.05));
  EXPECT_FALSE(rule.waits_for_landmarks());
}

// Costs ½ h (t − 1)² along a step for which the model says h = 1: the slope at its beginning is
// what the model has, h.
class LandmarkSearch : public ::testing::Test {
 protected:
  LandmarkSearch() : searches_(16.0) { searches_.Grow(1); }
  // A step that ends where the cost has changed so much; true if it is kept.
  bool Step(double slope, double change) {
    searches_.BeginPass();
    searches_.Begin(kLandmark);
    searches_.Add(kLandmark, change, slope);
    return searches_.End(kLandmark);
  }
  LandmarkSearches searches_;
};

TEST_F(LandmarkSearch, AParabolaLeavesNothing) {
  EXPECT_TRUE(Step(1.0, -0.5));
  EXPECT_EQ(searches_.left(), 0.0);
  EXPECT_EQ(searches_.promised(), 0.5);
}

// With a hundredth of the curvature the minimum is 100 steps away, and as many times lower.
TEST_F(LandmarkSearch, AFlatParabolaIsSeenToItsEnd) {
  const double curvature = 0.01;
  EXPECT_TRUE(Step(1.0, -1.0 + 0.5 * curvature));
  EXPECT_NEAR(searches_.left(), 0.5 / curvature - (1.0 - 0.5 * curvature), 1e-9);
  EXPECT_EQ(searches_.promised(), 0.5);
}

TEST_F(LandmarkSearch, WhereTheCostCurvesDownwardNobodyKnows) {
  EXPECT_TRUE(Step(1.0, -1.1));
  EXPECT_EQ(searches_.left(), std::numeric_limits<double>::infinity());
}

// At four times its length the step goes up the other side; the minimum is at 3/8 of it.
TEST_F(LandmarkSearch, ARefusedStepLeavesWhatItWasToGain) {
  EXPECT_TRUE(Step(1.0, -0.999));
  EXPECT_FALSE(Step(4.0, 4.0 / 3.0));
  EXPECT_NEAR(searches_.left(), 0.5 * 4.0 * 3.0 / 8.0, 1e-12);
  EXPECT_NEAR(searches_.stretch(kLandmark), 1.5, 1e-12);
}

TEST_F(LandmarkSearch, StepsGrowFourfoldAndToABound) {
  for (const double stretch : {4.0, 16.0, 16.0}) {
    EXPECT_TRUE(Step(1.0, -1.5));
    EXPECT_EQ(searches_.stretch(kLandmark), stretch);
  }
}

TEST_F(LandmarkSearch, NotANumberKeepsNothing) {
  EXPECT_FALSE(Step(1.0, std::nan("")));
  EXPECT_FALSE(Step(std::nan(""), -1.0));
  EXPECT_EQ(searches_.stretch(kLandmark), 1.0);
}

// The second step is four times as long as its model says, and so its slope is.
TEST_F(LandmarkSearch, APromiseIsThatOfTheModelsOwnStep) {
  EXPECT_TRUE(Step(1.0, -0.999));
  EXPECT_EQ(searches_.stretch(kLandmark), 4.0);
  EXPECT_TRUE(Step(4.0, -3.0));
  EXPECT_EQ(searches_.promised(), 0.5);
}

}  // namespace
}  // namespace inceres::internal
