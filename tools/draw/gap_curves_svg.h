#pragma once

#include <string>
#include <vector>

#include "tools/solve/solve_record.h"

namespace inceres::tools {

/// Who solved, and how its cost fell.
struct GapCurve {
  std::string label;
  std::vector<CostSample> trace;
};

/// How far each solve is above the lowest cost of all, relative to it, over the seconds that have
/// passed; both axes logarithmic, with lines at 1e-2, 1e-3 and 1e-4. A step down where a solve
/// holds a better state; <path class="curve" data-label="…">. A complete SVG document without
/// scripts or references. Requires lowest_cost > 0.
std::string GapCurvesSvg(const std::string& title, double lowest_cost,
                         const std::vector<GapCurve>& curves);

}  // namespace inceres::tools
