#pragma once

#include <cstdint>
#include <vector>

#include "incremental/index_set.h"

namespace inceres::internal {

/// What each landmark could still gain by itself, ½ ηᵀ(P + λD)⁻¹η, and which of them could gain
/// much.
class LandmarkGains {
 public:
  void Grow(std::size_t num_landmarks) {
    gains_.resize(num_landmarks, 0.0);
    eager_.Grow(num_landmarks);
    above_.reserve(gains_.capacity());
    below_.reserve(gains_.capacity());
  }
  void Set(std::int32_t landmark, double gain);

  double operator[](std::int32_t landmark) const { return gains_[landmark]; }
  /// Their sum. Kept by difference, and summed anew when rounding may have eaten more than
  /// `accuracy`.
  double Total(double accuracy);
  /// Landmarks whose gain is above the threshold. Cheap while the threshold does not fall far.
  const std::vector<std::int32_t>& Above(double threshold);

 private:
  std::vector<double> gains_;
  double total_ = 0.0;
  double error_ = 0.0;      // bound of its rounding error since it was summed
  double threshold_ = 0.0;  // what eager_ was collected with
  IndexSet eager_;
  std::vector<std::int32_t> above_;
  std::vector<std::int32_t> below_;
};

}  // namespace inceres::internal
