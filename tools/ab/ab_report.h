#pragma once

#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/ab/ab_protocol.h"
#include "tools/problems/gauge.h"

namespace inceres::tools {

/// What the report says besides the measurements.
struct AbContext {
  std::string problem;      ///< as given on the command line
  std::string description;  ///< its sizes
  int threads = 1;
  SolverSettings settings;
  GeometryDifference difference;  ///< ours against the fastest stock
  std::vector<std::pair<std::string, std::string>> environment;
};

/// The report for people: environment, a line per contender, ratio and differences.
std::string AbTable(const AbContext& context, const AbResult& result);

/// The cost of each over time, of the first round: GapCurvesSvg.
std::string AbPicture(const AbContext& context, const AbResult& result);

/// The report for programs. Seconds throughout; "time_to_gap" maps "1e-2" … "1e-5" to the median
/// over the rounds of the seconds until the cost was within that gap, relative, of the lowest final
/// cost of all runs, null if it never was.
nlohmann::json AbJson(const AbContext& context, const AbResult& result);

}  // namespace inceres::tools
