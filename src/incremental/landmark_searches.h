#pragma once

#include <algorithm>
#include <cmath>
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
  /// Landmarks step together.
  void BeginPass() { left_ = promised_ = 0.0; }
  /// Of a pass that was given up.
  void EndUnknown() { left_ = HUGE_VAL; }
  /// What they have left to gain, by the curvatures seen along their steps.
  double left() const { return left_; }
  /// What the models of all of them have promised.
  double promised() const { return promised_; }
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
    promised_ += 0.5 * search.slope / search.stretch;
    // Written so that NaN keeps nothing.
    if (!(search.change < HUGE_VAL) || !(search.slope > 0.0)) {
      search.stretch = 1.0;
      return false;
    }
    const double curvature = 2.0 * (search.slope + search.change);
    // The minimum of the parabola, as a multiple of this step. A curvature that is small, or
    // negative, where the cost falls faster than its slope, gives the bound.
    const double best = search.slope / std::max(curvature, search.slope / kMaxGrowth);
    // Never below 1: a step that has gained is not shortened the next time.
    search.stretch = std::clamp(search.stretch * best, 1.0, max_stretch_);
    // Where the cost curves downward nobody knows how much is left.
    const double at_minimum =
        curvature > 0.0 ? -0.5 * search.slope * search.slope / curvature : -HUGE_VAL;
    const bool gains = search.change < 0.0;
    left_ += std::max(0.0, (gains ? search.change : 0.0) - at_minimum);
    return gains;
  }

 private:
  // From one step to the next: a robust loss has kinks, beyond which a parabola says nothing.
  static constexpr double kMaxGrowth = 4.0;

  struct Search {
    double stretch = 1.0;  // of its next step
    double change = 0.0;
    double slope = 0.0;
  };
  const double max_stretch_;
  // Of the pass.
  double left_ = 0.0;
  double promised_ = 0.0;
  std::vector<Search> searches_;
};

}  // namespace inceres::internal
