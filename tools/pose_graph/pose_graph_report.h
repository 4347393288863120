#pragma once

#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/pose_graph/pose_graph_run.h"

namespace inceres::tools {

/// "3500 poses in 2D, 5453 edges, 1954 loops".
std::string Describe(const PoseGraphRun& run);

/// The rows of the table: names and texts.
std::vector<std::pair<std::string, std::string>> Figures(const PoseGraphRun& run);

/// The report of --json.
nlohmann::json PoseGraphJson(const std::string& input, const PoseGraphPlan& plan,
                             const PoseGraphRun& run);

}  // namespace inceres::tools
