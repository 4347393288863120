#include "base/stopwatch.h"

#include <chrono>
#include <thread>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

TEST(StageTimer, AddsItsLifetimeToWhatIsThere) {
  double seconds = 100.0;
  const double start = NowInSeconds();
  {
    const StageTimer timer(&seconds);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  EXPECT_GE(seconds, 100.005);
  EXPECT_LE(seconds - 100.0, NowInSeconds() - start + 1e-9);
}

TEST(StageClock, SharesItsLifetimeOutAmongStages) {
  const auto sleep = [] { std::this_thread::sleep_for(std::chrono::milliseconds(5)); };
  StageClock clock;
  const double start = clock.now();
  double first = 100.0;
  double second = 0.0;
  sleep();
  clock.Charge(&first);
  EXPECT_GE(first, 100.005);
  EXPECT_NEAR(first - 100.0, clock.now() - start, 1e-9);
  sleep();
  clock.Read();  // nobody's
  const double before = clock.now();
  sleep();
  clock.Charge(&second);
  EXPECT_GE(second, 0.005);
  EXPECT_EQ(second, clock.now() - before);
}

}  // namespace
}  // namespace inceres::internal
