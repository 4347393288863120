#include "base/scientific.h"

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <limits>
#include <random>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

void ExpectAsPrinted(double value) {
  char expected[64];
  std::snprintf(expected, sizeof(expected), "%e", value);
  EXPECT_STREQ(Scientific(value).text(), expected);
}

TEST(Scientific, IsWhatPrintfWrites) {
  using Limits = std::numeric_limits<double>;
  for (const double value :
       {0.0, -0.0, 1.0, 9.9999995, 9.99999949999, 0.5, 2.5e-7, 1e100, 1e-100, Limits::max(),
        Limits::min(), Limits::denorm_min(), Limits::infinity(), Limits::quiet_NaN()}) {
    ExpectAsPrinted(value);
    ExpectAsPrinted(-value);
  }
  std::mt19937_64 random(3);
  for (int i = 0; i < 10000; ++i) {
    const std::uint64_t bits = random();
    double value;
    std::memcpy(&value, &bits, sizeof(value));
    ExpectAsPrinted(value);
  }
}

}  // namespace
}  // namespace inceres::internal
