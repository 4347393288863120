#pragma once

#include <vector>

#include "linear/coarse_columns.h"
#include "schur/frame_aggregates.h"
#include "schur/gauge_modes.h"

namespace inceres::internal {

/// Which columns of V each aggregate of frames has. By gauge: the seven gauge modes; else, or where
/// they do not fit, one for each parameter of a frame (of the first seven), which frames of the
/// same size share. A shared frame has all of its parameters.
class ModeColumns {
 public:
  /// `offsets`: first scalar of each frame, and the total.
  ModeColumns(const FrameAggregates& aggregates, const std::vector<int>& offsets, bool by_gauge);

  /// Per aggregate.
  const std::vector<int>& widths() const { return widths_; }
  /// V of the columns; null: the modes do not fit.
  void Write(const GaugeFit* modes, CoarseColumns* columns) const;

 private:
  const std::vector<char> is_shared_;
  std::vector<int> widths_;
  std::vector<int> constant_column_;  // per frame: the first of its own, without gauge modes
};

}  // namespace inceres::internal
