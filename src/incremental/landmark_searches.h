#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace inceres::internal {

/// Line searches of landmarks that step by themselves, from one step of theirs to the next: how far
/// each goes, as a multiple of what its model says. With a robust loss the Gauss–Newton model of an
/// outlier is too stiff, and damping holds a far point back.
class LandmarkSearches {
 public:
  /// `max_stretch`: Tuning::Landmarks::max_stretch.
  explicit LandmarkSearches(double max_stretch) : max_stretch_(max_stretch) {}

  void Grow(std::size_t num_landmarks) { searches_.resize(num_landmarks); }
  /// What has been seen does not hold from other values.
  void Forget(std::int32_t landmark) { searches_[landmark] = {}; }

  double stretch(std::int32_t landmark) const { return searches_[landmark].stretch; }
  /// Another step of the landmark; then factor by factor by how much its cost changes along it, and
  /// how steeply it falls at its beginning.
  void Begin(std::int32_t landmark) {
    searches_[landmark].change = searches_[landmark].slope = 0.0;
  }
  void Add(std::int32_t landmark, double change, double slope) {
    searches_[landmark].change += change;
    searches_[landmark].slope += slope;
  }
  /// Whether the step lowers the cost; and how long the next one is to be: as long as the slope and
  /// the curvature seen along this one ask for, within a bound. The cost along the step is − slope
  /// t + ½ curvature t², and `change` at t = 1.
  bool End(std::int32_t landmark) {
    Search& search = searches_[landmark];
    // Written so that NaN keeps nothing.
    if (!(search.change < 0.0) || !(search.slope > 0.0)) {
      search.stretch = 1.0;
      return false;
    }
    const double curvature = 2.0 * (search.slope + search.change);
    // The minimum of the parabola, as a multiple of this step. A curvature that is small, or
    // negative, where the cost falls faster than its slope, gives the bound.
    const double best = search.slope / std::max(curvature, search.slope / max_stretch_);
    // Never below 1: a step that has gained is not shortened the next time.
    search.stretch = std::clamp(search.stretch * best, 1.0, max_stretch_);
    return true;
  }

 private:
  struct Search {
    double stretch = 1.0;  // of its next step
    double change = 0.0;
    double slope = 0.0;
  };
  const double max_stretch_;
  std::vector<Search> searches_;
};

}  // namespace inceres::internal
