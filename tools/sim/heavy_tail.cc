#include "tools/sim/heavy_tail.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace inceres::internal {
namespace {

constexpr double kLeastExponent = 0.05, kLargestExponent = 50.0;
constexpr int kSteps = 60;

}  // namespace

HeavyTail::HeavyTail(double mean, const std::vector<int>& limits,
                     const std::vector<std::int64_t>& draws) {
  double count = 0.0;
  for (const std::int64_t number : draws) {
    count += static_cast<double>(number);
  }
  double low = kLeastExponent, high = kLargestExponent;
  for (int step = 0; step < kSteps; ++step) {
    exponent_ = 0.5 * (low + high);
    Expect(limits, draws);
    (sum_ > mean * count ? low : high) = exponent_;
  }
}

// Σ_{j = 1}^{limit} P(draw ≥ j) = 2 + Σ_{j = 3}^{limit} (2 / j)^α.
void HeavyTail::Expect(const std::vector<int>& limits, const std::vector<std::int64_t>& draws) {
  const int longest = *std::max_element(limits.begin(), limits.end());
  expected_.assign(static_cast<std::size_t>(longest) + 1, 2.0);
  for (int j = 3; j <= longest; ++j) {
    expected_[static_cast<std::size_t>(j)] =
        expected_[static_cast<std::size_t>(j - 1)] +
        PortableExp(-exponent_ * PortableLog(0.5 * static_cast<double>(j)));
  }
  sum_ = 0.0;
  for (std::size_t i = 0; i < limits.size(); ++i) {
    sum_ += static_cast<double>(draws[i]) * Expected(limits[i]);
  }
}

int HeavyTail::Draw(int limit, Random* random) const {
  const double log_u = PortableLog(1.0 - random->Uniform());
  const double length = 2.0 * PortableExp(std::min(-log_u / exponent_, 30.0));
  return static_cast<int>(std::min(std::floor(length), static_cast<double>(limit)));
}

}  // namespace inceres::internal
