#pragma once

#include <string>
#include <vector>

#include "inceres/io/bal.h"
#include "tools/solve/solve_record.h"

namespace inceres::tools {

/// A solve in one picture: cameras and points from above before and after, in the same frame and
/// scale, and the cost curve. "Above" is the mean of the cameras' own up directions. Far outliers
/// are clipped; of many points an even sample is drawn. The result is a complete SVG document
/// without scripts or references; each camera is a <path class="camera">, in the groups "before"
/// and "after". `before` and `after` have the same sizes and both Validate().
std::string BalPictureSvg(const std::string& title, const BalProblem& before,
                          const BalProblem& after, const std::vector<CostSample>& trace);

}  // namespace inceres::tools
