#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/replay/replay_run.h"

namespace inceres::tools {

/// The steps first … last of a replay: what ours needs for one of them, by the median.
struct ReplayWindow {
  int first = 0;
  int last = 0;
  double ms = 0.0;         ///< the solve
  double growth_ms = 0.0;  ///< adding the step
  double iterations = 0.0;
  /// counts by name, "bytes" aside; both windows have those of the late one, in its order
  std::vector<std::pair<std::string, double>> work;
  /// bytes held after the last step over the number of steps so far
  std::optional<double> bytes_per_step;
};

/// Whether a step costs the same however much came before.
struct ReplayFlatness {
  ReplayWindow early;
  ReplayWindow late;
};

/// The least number of steps that MeasureFlatness needs.
constexpr int kMinFlatnessSteps = 351;

/// Steps 150 … 250 against the last hundred. Requires kMinFlatnessSteps rows.
ReplayFlatness MeasureFlatness(const std::vector<ReplayRow>& rows);

/// 100 (late − early) / early; absent if early is 0.
std::optional<double> GrowthInPercent(double early, double late);

/// A table for people.
std::string FlatnessText(const ReplayFlatness& flatness);

/// {"early": {"first", "last", "ms", "growth_ms", "iterations", "work": {…}, "bytes_per_step" (null
/// without)}, "late": {…}, "growth_percent": {"ms", "growth_ms", "iterations", "bytes_per_step",
/// "work": {…}}, null where there is none to speak of}.
nlohmann::json FlatnessJson(const ReplayFlatness& flatness);

}  // namespace inceres::tools
