#pragma once

#include <vector>

#include "linearize/point_pair.h"

namespace inceres::internal {

/// The cheapest state that a solve has accepted. Where that is the current point, as mostly, there
/// is no copy of it.
class BestState {
 public:
  /// At first the current point. Of the memory for a copy nothing is touched yet.
  BestState(const PointPair& points, std::vector<double>* memory)
      : points_(points), copy_(*memory) {
    copy_.reserve(points.current().size());
  }

  /// Until the current point moves.
  const std::vector<double>& get() const { return is_current_ ? points_.current() : copy_; }

  /// The current point is a new one, while the candidate still is the one before.
  void Follow(bool current_is_best) {
    if (is_current_ && !current_is_best) {
      copy_ = points_.candidate();
    }
    is_current_ = current_is_best;
  }

 private:
  const PointPair& points_;
  std::vector<double>& copy_;
  bool is_current_ = true;
};

}  // namespace inceres::internal
