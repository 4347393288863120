#include "tools/ab/ab_report.h"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>

#include "src/base/formatted.h"
#include "tools/command_line/json_values.h"
#include "tools/draw/gap_curves_svg.h"

namespace inceres::tools {
namespace {

using internal::Formatted;
using nlohmann::json;

struct Gap {
  const char* name;
  double value;
};
constexpr std::array<Gap, 4> kGaps = {
    {{"1e-2", 1e-2}, {"1e-3", 1e-3}, {"1e-4", 1e-4}, {"1e-5", 1e-5}}};

std::string TableRow(const ContenderRuns& runs, const Spread& ratio) {
  const Spread seconds = runs.Seconds();
  const SolveRecord& record = runs.first();
  return Formatted("%-8s %-26s %9.4f %9.4f %9.4f %8.2f  %13.6e  %17.11e %5d  %-14s %6.3f\n",
                   runs.solver.c_str(), runs.configuration.c_str(), seconds.median, seconds.min,
                   seconds.max, 1e3 * runs.SecondsPerIteration(), record.initial_cost,
                   record.final_cost, record.iterations, record.termination.c_str(), ratio.median);
}

json ToJson(const Spread& spread) {
  return {{"median", spread.median}, {"min", spread.min}, {"max", spread.max}};
}

std::optional<double> MedianToGap(const ContenderRuns& runs, double lowest_cost, double gap) {
  std::vector<std::optional<double>> seconds;
  for (const SolveRecord& record : runs.rounds) {
    seconds.push_back(TimeToGap(record.trace, lowest_cost, gap));
  }
  return MedianOrNever(seconds);
}

json TimesToGaps(const ContenderRuns& runs, double lowest_cost) {
  json times = json::object();
  for (const Gap& gap : kGaps) {
    times[gap.name] = OrNull(MedianToGap(runs, lowest_cost, gap.value));
  }
  return times;
}

// "1.2 s", or a dash where the cost never came so near.
std::string GapTable(const AbResult& result) {
  const double lowest_cost = result.LowestCost();
  std::string text = "\nmedian seconds until the cost was so near the lowest, relative:\n";
  text += Formatted("%-8s %-26s", "solver", "configuration");
  for (const Gap& gap : kGaps) {
    text += Formatted(" %10s", gap.name);
  }
  text += "\n";
  const auto add = [&](const ContenderRuns& runs) {
    text += Formatted("%-8s %-26s", runs.solver.c_str(), runs.configuration.c_str());
    for (const Gap& gap : kGaps) {
      const std::optional<double> median = MedianToGap(runs, lowest_cost, gap.value);
      text += median ? Formatted(" %10.4f", *median) : Formatted(" %10s", "-");
    }
    text += "\n";
  };
  add(result.ours);
  std::for_each(result.stock.begin(), result.stock.end(), add);
  return text;
}

json RunJson(const ContenderRuns& runs, double lowest_cost) {
  const SolveRecord& record = runs.first();
  return {{"solver", runs.solver},
          {"configuration", runs.configuration},
          {"linear_solver", record.linear_solver},
          {"seconds", ToJson(runs.Seconds())},
          {"seconds_per_iteration", runs.SecondsPerIteration()},
          {"stage_seconds", JsonObject(runs.StageSeconds())},
          {"initial_cost", record.initial_cost},
          {"final_cost", record.final_cost},
          {"final_cost_spread", runs.FinalCostSpread()},
          {"iterations", record.iterations},
          {"termination", record.termination},
          {"message", record.message},
          {"time_to_gap", TimesToGaps(runs, lowest_cost)}};
}

std::string Header(const AbContext& context, const AbResult& result) {
  std::string text = context.problem + ": " + context.description +
                     "; threads: " + std::to_string(context.threads) +
                     ", repeats: " + std::to_string(result.ours.rounds.size()) +
                     ", loss: " + ToString(context.settings.robust) + "\n";
  for (const auto& [name, value] : context.environment) {
    text += "  " + name + ": " + value + "\n";
  }
  return text + "\n";
}

}  // namespace

std::string AbTable(const AbContext& context, const AbResult& result) {
  std::string text = Header(context, result);
  text += Formatted("%-8s %-26s %9s %9s %9s %8s  %13s  %17s %5s  %-14s %6s\n", "solver",
                    "configuration", "median s", "min s", "max s", "ms/iter", "initial cost",
                    "final cost", "iter", "termination", "ours/x");
  text += TableRow(result.ours, {1.0, 1.0, 1.0});
  for (const ContenderRuns& runs : result.stock) {
    text += TableRow(runs, result.RatioTo(runs));
  }
  for (const Dropped& dropped : result.dropped) {
    text += Formatted("%-8s %-26s dropped: %s\n", "ceres", dropped.configuration.c_str(),
                      dropped.reason.c_str());
  }
  text += GapTable(result);
  const Spread ratio = result.RatioToBestStock();
  text +=
      Formatted("\nratio to the best stock (%s): median %.3f, min %.3f, max %.3f\n",
                result.FastestStock().configuration.c_str(), ratio.median, ratio.min, ratio.max);
  text += Formatted("relative difference of final costs (ours - lowest stock): %.3e\n",
                    result.RelativeCostDifference());
  text += Formatted(
      "largest parameter difference, gauge removed: positions %.2e and points %.2e of the scene "
      "size, rotations %.2e rad\n",
      context.difference.positions, context.difference.points, context.difference.rotations);
  return text;
}

std::string AbPicture(const AbContext& context, const AbResult& result) {
  std::vector<GapCurve> curves;
  const auto add = [&](const ContenderRuns& runs) {
    curves.push_back({runs.solver + ", " + runs.configuration, runs.first().trace});
  };
  add(result.ours);
  std::for_each(result.stock.begin(), result.stock.end(), add);
  // Not 0: what is below is rounding, as for RelativeCostDifference.
  const double lowest_cost =
      std::max({result.LowestCost(), 1e-16 * result.ours.first().initial_cost,
                std::numeric_limits<double>::min()});
  return GapCurvesSvg(
      context.problem.substr(context.problem.rfind('/') + 1) + ": " + context.description,
      lowest_cost, curves);
}

json AbJson(const AbContext& context, const AbResult& result) {
  const double lowest_cost = result.LowestCost();
  json runs = json::array({RunJson(result.ours, lowest_cost)});
  for (const ContenderRuns& stock : result.stock) {
    runs.push_back(RunJson(stock, lowest_cost));
  }
  json dropped = json::array();
  for (const Dropped& entry : result.dropped) {
    dropped.push_back({{"configuration", entry.configuration}, {"reason", entry.reason}});
  }
  return {{"problem", context.problem},
          {"description", context.description},
          {"threads", context.threads},
          {"repeats", result.ours.rounds.size()},
          {"robust", ToString(context.settings.robust)},
          {"builtin_factors", context.settings.builtin_factors},
          {"inner_iterations", context.settings.inner_iterations},
          {"runs", runs},
          {"dropped", dropped},
          {"best_stock", result.FastestStock().configuration},
          {"ratio_to_best_stock", ToJson(result.RatioToBestStock())},
          {"relative_cost_difference", result.RelativeCostDifference()},
          {"parameter_difference",
           {{"largest", context.difference.Largest()},
            {"positions", context.difference.positions},
            {"points", context.difference.points},
            {"rotations", context.difference.rotations}}},
          {"options_without_effect", result.ours.first().options_without_effect},
          {"environment", JsonObject(context.environment)}};
}

}  // namespace inceres::tools
