#include "robust/threshold_scale.h"

#include <algorithm>
#include <cstddef>

// Matching of quantiles (Huber & Ronchetti 2009, section 5.1): how much smaller measured errors
// are than a chi-square distribution of unit information lets expect. The largest of several
// quantiles is taken, since real errors have longer tails than their middle tells; how far it may
// exceed the median's ratio is limited, so that wrong measurements among them do not set the
// scale.

namespace inceres::internal {
namespace {

constexpr double kProbabilities[] = {0.5, 0.75, 0.9, 0.95};
constexpr std::size_t kLeastCount = 20;
// Times the ratio at the median: what is further out is not the tail of right ones.
constexpr double kLongestTail = 10.0;
// Errors of measurements that are exact, or that nothing contradicts, are rounding.
constexpr double kLeastScale = 1e-8;

}  // namespace

double ThresholdScale(int degrees, std::vector<double>* squared_errors) {
  std::vector<double>& errors = *squared_errors;
  if (errors.size() < kLeastCount) {
    return 1.0;
  }
  // Order statistics: an entry at or below each probability, no interpolation.
  std::sort(errors.begin(), errors.end());
  double largest = 0.0, at_median = 0.0;
  for (const double probability : kProbabilities) {
    const auto at = static_cast<std::size_t>(probability * static_cast<double>(errors.size() - 1));
    largest = std::max(largest, errors[at] / ChiSquareQuantile(probability, degrees));
    // The median is the first one.
    at_median = probability == 0.5 ? largest : at_median;
  }
  return std::clamp(kTightTails * std::min(largest, kLongestTail * at_median), kLeastScale, 1.0);
}

}  // namespace inceres::internal
