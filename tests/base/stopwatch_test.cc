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

}  // namespace
}  // namespace inceres::internal
