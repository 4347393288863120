#include "tools/replay/replay_flatness.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "src/base/formatted.h"
#include "tools/ab/statistics.h"
#include "tools/command_line/json_values.h"

namespace inceres::tools {
namespace {

using internal::Formatted;

constexpr char kBytes[] = "bytes";

const ReplaySide& Ours(const std::vector<ReplayRow>& rows, int step) {
  return rows[static_cast<std::size_t>(step - 1)].ours;
}

template <typename Value>
double MedianOf(const std::vector<ReplayRow>& rows, int first, int last, const Value& value) {
  std::vector<double> values;
  for (int step = first; step <= last; ++step) {
    values.push_back(value(Ours(rows, step)));
  }
  return Summarize(std::move(values)).median;
}

// Of the steps first … last.
std::vector<std::string> NamesOfWork(const std::vector<ReplayRow>& rows, int first, int last) {
  std::vector<std::string> names;
  for (int step = first; step <= last; ++step) {
    for (const auto& [name, count] : Ours(rows, step).outcome.work) {
      if (std::find(names.begin(), names.end(), name) == names.end()) {
        names.push_back(name);
      }
    }
  }
  return names;
}

// A step need not have each count; not a number where none has it.
double MedianCount(const std::vector<ReplayRow>& rows, int first, int last,
                   const std::string& wanted) {
  std::vector<double> counts;
  for (int step = first; step <= last; ++step) {
    for (const auto& [name, count] : Ours(rows, step).outcome.work) {
      if (name == wanted) {
        counts.push_back(static_cast<double>(count));
      }
    }
  }
  return counts.empty() ? std::numeric_limits<double>::quiet_NaN()
                        : Summarize(std::move(counts)).median;
}

ReplayWindow WindowOf(const std::vector<ReplayRow>& rows, const std::vector<std::string>& names,
                      int first, int last) {
  ReplayWindow window;
  window.first = first;
  window.last = last;
  window.ms = MedianOf(rows, first, last,
                       [](const ReplaySide& side) { return 1e3 * side.outcome.seconds; });
  window.growth_ms =
      MedianOf(rows, first, last, [](const ReplaySide& side) { return 1e3 * side.growth_seconds; });
  window.iterations = MedianOf(
      rows, first, last, [](const ReplaySide& side) { return 1.0 * side.outcome.iterations; });
  for (const std::string& name : names) {
    if (name == kBytes) {
      window.bytes_per_step = MedianCount(rows, last, last, name) / last;
    } else {
      window.work.emplace_back(name, MedianCount(rows, first, last, name));
    }
  }
  return window;
}

std::optional<double> BytesGrowth(const ReplayFlatness& flatness) {
  return flatness.early.bytes_per_step.has_value() && flatness.late.bytes_per_step.has_value()
             ? GrowthInPercent(*flatness.early.bytes_per_step, *flatness.late.bytes_per_step)
             : std::nullopt;
}

nlohmann::json ToJson(const ReplayWindow& window) {
  return {{"first", window.first},
          {"last", window.last},
          {"ms", window.ms},
          {"growth_ms", window.growth_ms},
          {"iterations", window.iterations},
          {"work", JsonObject(window.work)},
          {"bytes_per_step", OrNull(window.bytes_per_step)}};
}

void AppendLine(std::string* text, const std::string& name, double early, double late) {
  *text += Formatted("%-30s %14.4g %14.4g", name.c_str(), early, late);
  if (const std::optional<double> growth = GrowthInPercent(early, late)) {
    *text += Formatted(" %+9.1f %%", *growth);
  }
  *text += "\n";
}

}  // namespace

ReplayFlatness MeasureFlatness(const std::vector<ReplayRow>& rows) {
  const int steps = static_cast<int>(rows.size());
  const std::vector<std::string> names = NamesOfWork(rows, steps - 99, steps);
  return {WindowOf(rows, names, 150, 250), WindowOf(rows, names, steps - 99, steps)};
}

std::optional<double> GrowthInPercent(double early, double late) {
  return early != 0.0 ? std::optional<double>(100.0 * (late - early) / early) : std::nullopt;
}

std::string FlatnessText(const ReplayFlatness& flatness) {
  const ReplayWindow& early = flatness.early;
  const ReplayWindow& late = flatness.late;
  std::string text;
  const std::string ranges[] = {std::to_string(early.first) + "-" + std::to_string(early.last),
                                std::to_string(late.first) + "-" + std::to_string(late.last)};
  text += Formatted("\nours, median of steps          %14s %14s     growth\n", ranges[0].c_str(),
                    ranges[1].c_str());
  AppendLine(&text, "ms", early.ms, late.ms);
  AppendLine(&text, "ms to add the step", early.growth_ms, late.growth_ms);
  AppendLine(&text, "iterations", early.iterations, late.iterations);
  for (std::size_t i = 0; i < late.work.size(); ++i) {
    AppendLine(&text, late.work[i].first, early.work[i].second, late.work[i].second);
  }
  if (early.bytes_per_step.has_value() && late.bytes_per_step.has_value()) {
    AppendLine(&text, "bytes held, per step so far", *early.bytes_per_step, *late.bytes_per_step);
  }
  return text;
}

nlohmann::json FlatnessJson(const ReplayFlatness& flatness) {
  const ReplayWindow& early = flatness.early;
  const ReplayWindow& late = flatness.late;
  nlohmann::json work = nlohmann::json::object();
  for (std::size_t i = 0; i < late.work.size(); ++i) {
    work[late.work[i].first] = OrNull(GrowthInPercent(early.work[i].second, late.work[i].second));
  }
  return {{"early", ToJson(early)},
          {"late", ToJson(late)},
          {"growth_percent",
           {{"ms", OrNull(GrowthInPercent(early.ms, late.ms))},
            {"growth_ms", OrNull(GrowthInPercent(early.growth_ms, late.growth_ms))},
            {"iterations", OrNull(GrowthInPercent(early.iterations, late.iterations))},
            {"bytes_per_step", OrNull(BytesGrowth(flatness))},
            {"work", work}}}};
}

}  // namespace inceres::tools
