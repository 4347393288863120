#include "incremental/landmark_gains.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace inceres::internal {

// Gains ½ ‖z‖² of the landmarks, their sum and a list of the large ones. Both are kept by
// difference, for an iteration changes few of very many: Set is O(1), Above costs the list. The
// sum carries a bound of its own rounding, ε times all that was added, and is summed anew when a
// caller needs more than that. eager_ has all landmarks above threshold_, and some below it that
// are sorted out when asked.

void LandmarkGains::Set(std::int32_t landmark, double gain) {
  total_ += gain - gains_[landmark];
  error_ += std::numeric_limits<double>::epsilon() * (std::fabs(total_) + gain + gains_[landmark]);
  gains_[landmark] = gain;
  if (gain > threshold_) {
    eager_.Add(landmark);
  }
}

double LandmarkGains::Total(double accuracy) {
  if (error_ > accuracy) {
    error_ = 0.0;
    total_ = std::accumulate(gains_.begin(), gains_.end(), 0.0);
  }
  // Rounding may leave a sum of nothing slightly negative.
  return std::max(0.0, total_);
}

const std::vector<std::int32_t>& LandmarkGains::Above(double threshold) {
  // Below what eager_ was collected with: all landmarks have to be looked at.
  if (threshold < threshold_) {
    threshold_ = 0.1 * threshold;  // room to fall before all landmarks must be looked at again
    for (std::int32_t i = 0; i < static_cast<std::int32_t>(gains_.size()); ++i) {
      if (gains_[i] > threshold_) {
        eager_.Add(i);
      }
    }
  } else if (threshold > 100.0 * threshold_) {
    // The list would be far too long for what is asked now; entries below are removed on the way.
    threshold_ = 0.1 * threshold;
  }
  above_.clear();
  below_.clear();
  // Not while the set is walked.
  eager_.ForEach([&](std::int32_t i) { (gains_[i] > threshold ? above_ : below_).push_back(i); });
  for (const std::int32_t i : below_) {
    if (gains_[i] <= threshold_) {
      eager_.Remove(i);
    }
  }
  return above_;
}

}  // namespace inceres::internal
