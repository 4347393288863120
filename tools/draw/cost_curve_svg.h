#pragma once

#include <string>
#include <vector>

#include "tools/solve/solve_record.h"

namespace inceres::tools {

/// A rectangle of a picture.
struct SvgFrame {
  double left = 0.0;
  double top = 0.0;
  double width = 0.0;
  double height = 0.0;
};

/// The cost over the iterations: a line through the accepted costs, a <circle class="accepted"> or
/// "rejected" for each iteration, labeled grid lines. The vertical axis is logarithmic and spans
/// the accepted costs; others are drawn at its edge. Labels are left of the frame.
std::string CostCurveShapes(const std::vector<CostSample>& trace, const SvgFrame& frame);

/// The same as an SVG group of id "cost" with a caption.
std::string CostCurveSvg(const std::vector<CostSample>& trace, const SvgFrame& frame);

}  // namespace inceres::tools
