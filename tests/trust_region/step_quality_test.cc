// The ratio of actual to predicted decrease, monotone and not.
#include "trust_region/step_quality.h"

#include <limits>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

TEST(StepQuality, MonotoneIsThePlainRatio) {
  StepQuality quality(10.0, 0);
  EXPECT_DOUBLE_EQ(quality.Evaluate(8.0, 4.0), 0.5);
  EXPECT_DOUBLE_EQ(quality.Evaluate(12.0, 4.0), -0.5);
  quality.StepAccepted(8.0, 4.0);
  EXPECT_DOUBLE_EQ(quality.Evaluate(7.0, 2.0), 0.5);
  quality.StepAccepted(7.0, 2.0);
  EXPECT_DOUBLE_EQ(quality.Evaluate(7.5, 1.0), -0.5);
}

TEST(StepQuality, ACandidateThatCannotBeEvaluatedIsTheWorst) {
  const StepQuality quality(10.0, 3);
  EXPECT_EQ(quality.Evaluate(std::numeric_limits<double>::max(), 1.0),
            std::numeric_limits<double>::lowest());
  EXPECT_EQ(quality.Evaluate(std::numeric_limits<double>::infinity(), 1.0),
            std::numeric_limits<double>::lowest());
}

// An increase counts against the reference cost with the decreases predicted since.
TEST(StepQuality, IncreasesAreMeasuredAgainstTheReference) {
  StepQuality quality(10.0, 2);
  quality.StepAccepted(4.0, 5.0);  // reference stays 10, predicted since: 5
  EXPECT_DOUBLE_EQ(quality.Evaluate(6.0, 1.0),
                   (10.0 - 6.0) / 6.0);  // against the current cost it would be -2
  quality.StepAccepted(6.0, 1.0);
  EXPECT_DOUBLE_EQ(quality.Evaluate(5.0, 2.0), 0.625);  // (10 − 5) / (6 + 2) against (6 − 5) / 2
}

// After `window` steps without a new minimum, the reference becomes the highest cost since the
// minimum.
TEST(StepQuality, TheReferenceMovesWhenTheWindowIsFull) {
  StepQuality quality(10.0, 2);
  quality.StepAccepted(4.0, 5.0);
  quality.StepAccepted(7.0, 1.0);
  quality.StepAccepted(6.0, 1.0);
  // Reference 7; predicted since it: 1. Now (7 − 6.5) / (1 + 1) against (6 − 6.5) / 1.
  EXPECT_DOUBLE_EQ(quality.Evaluate(6.5, 1.0), 0.25);
}

TEST(StepQuality, ANewMinimumStartsTheCountAnew) {
  StepQuality quality(10.0, 2);
  quality.StepAccepted(11.0, 1.0);
  quality.StepAccepted(4.0, 5.0);
  quality.StepAccepted(5.0, 1.0);
  // One step since the minimum: the reference is still 10, predicted since it: 7.
  EXPECT_DOUBLE_EQ(quality.Evaluate(6.0, 1.0), 0.5);
  quality.StepAccepted(4.5, 1.0);
  // Two: the reference is now 5, predicted since it: 1.
  EXPECT_NEAR(quality.Evaluate(4.8, 1.0), 0.1, 1e-14);
}

}  // namespace
}  // namespace inceres::internal
