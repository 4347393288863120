#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "tools/draw/cost_curve_svg.h"

namespace inceres::tools {

/// How many values lie between which bounds, of two samples in the same bins. Bins are equally wide
/// in the logarithm.
struct ErrorHistogram {
  std::vector<double> edges;        ///< one more than bins, rising
  std::vector<std::size_t> before;  ///< a count a bin
  std::vector<std::size_t> after;
  std::size_t not_finite = 0;  ///< values of both that are in no bin
};

/// Sorts reprojection errors (pixels, at least 0) into `num_bins` bins from the smallest to the
/// largest; those below a thousandth of the median of `after` count as that, for a few errors near
/// 0 would stretch the axis.
ErrorHistogram SortErrors(const std::vector<double>& before, const std::vector<double>& after,
                          std::size_t num_bins);

/// The histogram back to back over one axis: <rect class="after"> upward, <rect class="before">
/// downward, each with its count as a tooltip; labels below the frame. `num_labels` is how many
/// have room.
std::string ErrorHistogramShapes(const ErrorHistogram& histogram, const SvgFrame& frame,
                                 std::size_t num_labels);

/// Errors that a half, 95 % and all of the sample do not exceed, pixels.
struct ErrorSpread {
  double median = 0.0;
  double p95 = 0.0;
  double max = 0.0;
};

/// Of the finite ones; zeros if there are none.
ErrorSpread SpreadOf(const std::vector<double>& errors);

}  // namespace inceres::tools
