#pragma once

#include <string>
#include <vector>

#include "inceres/io/g2o.h"

namespace inceres::tools {

/// A pose graph before and after a solve, side by side, as an SVG document: odometry as a line,
/// loops thin, edges that were found to be outliers dashed in red. Seen along the axis in which the
/// solved graph is smallest; both panels have the scale of the solved graph's own box, or of the
/// start's where that is larger up to twice, and are clipped. `is_outlier` is by edge of `after`;
/// before and after have the same vertices and edges.
std::string PoseGraphPictureSvg(const std::string& title, const PoseGraph& before,
                                const PoseGraph& after, const std::vector<bool>& is_outlier);

/// The same picture in an HTML page, with a table of figures: name and text, in order.
std::string PoseGraphPageHtml(const std::string& title, const std::string& svg,
                              const std::vector<std::pair<std::string, std::string>>& figures);

}  // namespace inceres::tools
