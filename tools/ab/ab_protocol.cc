#include "tools/ab/ab_protocol.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace inceres::tools {
namespace {

std::string Describe(const SolveRecord& record) {
  return record.termination + ": " + record.message;
}

// Runs ours once; a solve that is of no use for the comparison is an error.
Status RunOurs(const Contender& ours, std::optional<int> iteration_limit, RunOutcome* outcome) {
  Status status = ours.run(iteration_limit, outcome);
  if (!status.ok()) {
    return status;
  }
  const SolveRecord& record = outcome->record;
  if (record.used_stock) {
    return Status::Error(
        StatusCode::kUnavailable,
        "NO MEASUREMENT: inceres handed this problem to stock Ceres, which would be "
        "compared with itself. Reason: " +
            record.fallback_reason);
  }
  return record.usable
             ? Status::Ok()
             : Status::Error(StatusCode::kEvaluationFailed, "inceres failed: " + Describe(record));
}

// Runs a stock configuration once; returns why it cannot be used, or nothing.
std::optional<std::string> RunStock(const Contender& stock, std::optional<int> iteration_limit,
                                    RunOutcome* outcome) {
  const Status status = stock.run(iteration_limit, outcome);
  if (!status.ok()) {
    return status.message;
  }
  return outcome->record.usable
             ? std::nullopt
             : std::optional<std::string>("failed: " + Describe(outcome->record));
}

std::string Milliseconds(double seconds) {
  return std::to_string(std::lround(1e3 * seconds)) + " ms";
}

// The stock configurations worth repeating; the others go to `dropped`.
std::vector<Contender> PrePass(const std::vector<Contender>& stock, const AbOptions& options,
                               std::vector<Dropped>* dropped) {
  std::vector<std::pair<Contender, double>> usable;
  double best = std::numeric_limits<double>::infinity();
  for (const Contender& contender : stock) {
    RunOutcome outcome;
    if (const auto problem = RunStock(contender, options.pre_pass_iterations, &outcome)) {
      dropped->push_back({contender.configuration, *problem});
      continue;
    }
    usable.emplace_back(contender, outcome.record.seconds);
    best = std::min(best, outcome.record.seconds);
  }
  std::vector<Contender> kept;
  for (const auto& [contender, seconds] : usable) {
    if (options.drop_slow && seconds > options.hopeless_factor * best) {
      dropped->push_back({contender.configuration, "hopelessly slow: " + Milliseconds(seconds) +
                                                       " for the pre-pass, the best " +
                                                       Milliseconds(best)});
    } else {
      kept.push_back(contender);
    }
  }
  return kept;
}

void Keep(RunOutcome outcome, ContenderRuns* runs) {
  if (runs->rounds.empty()) {
    runs->parameters = std::move(outcome.parameters);
  }
  runs->rounds.push_back(std::move(outcome.record));
}

// Stock runs that failed in some round are no standard to compare with.
void DropFailed(const std::vector<std::optional<std::string>>& failures, AbResult* result) {
  std::vector<ContenderRuns> kept;
  for (std::size_t i = 0; i < failures.size(); ++i) {
    if (failures[i].has_value()) {
      result->dropped.push_back({result->stock[i].configuration, *failures[i]});
    } else {
      kept.push_back(std::move(result->stock[i]));
    }
  }
  result->stock = std::move(kept);
}

Status RunRounds(const Contender& ours, const std::vector<Contender>& stock,
                 const AbOptions& options, const std::function<void(const std::string&)>& announce,
                 AbResult* result) {
  result->ours = {ours.solver, ours.configuration, {}, {}};
  for (const Contender& contender : stock) {
    result->stock.push_back({contender.solver, contender.configuration, {}, {}});
  }
  std::vector<std::optional<std::string>> failures(stock.size());
  for (int round = 0; round < options.repeats; ++round) {
    RunOutcome outcome;
    const Status status = RunOurs(ours, std::nullopt, &outcome);
    if (!status.ok()) {
      return status;
    }
    std::string line = "round " + std::to_string(round + 1) + "/" +
                       std::to_string(options.repeats) + ": inceres " +
                       Milliseconds(outcome.record.seconds);
    Keep(std::move(outcome), &result->ours);
    for (std::size_t i = 0; i < stock.size(); ++i) {
      if (failures[i].has_value()) {
        continue;
      }
      RunOutcome stock_outcome;
      failures[i] = RunStock(stock[i], std::nullopt, &stock_outcome);
      line += ", " + stock[i].configuration + " " +
              (failures[i] ? "failed" : Milliseconds(stock_outcome.record.seconds));
      Keep(std::move(stock_outcome), &result->stock[i]);
    }
    announce(line);
  }
  DropFailed(failures, result);
  return Status::Ok();
}

}  // namespace

Spread ContenderRuns::Seconds() const {
  std::vector<double> seconds;
  for (const SolveRecord& record : rounds) {
    seconds.push_back(record.seconds);
  }
  return Summarize(std::move(seconds));
}

double ContenderRuns::FinalCostSpread() const {
  std::vector<double> costs;
  for (const SolveRecord& record : rounds) {
    costs.push_back(record.final_cost);
  }
  const Spread spread = Summarize(std::move(costs));
  return spread.max - spread.min;
}

double ContenderRuns::SecondsPerIteration() const {
  return Seconds().median / std::max(1, first().iterations);
}

std::vector<std::pair<std::string, double>> ContenderRuns::StageSeconds() const {
  std::vector<std::pair<std::string, double>> medians;
  for (const auto& stage : first().stage_seconds) {
    std::vector<double> seconds;
    for (const SolveRecord& record : rounds) {
      for (const auto& [name, value] : record.stage_seconds) {
        if (name == stage.first) {
          seconds.push_back(value);
        }
      }
    }
    medians.emplace_back(stage.first, Summarize(std::move(seconds)).median);
  }
  return medians;
}

const ContenderRuns& AbResult::FastestStock() const {
  return *std::min_element(stock.begin(), stock.end(),
                           [](const ContenderRuns& a, const ContenderRuns& b) {
                             return a.Seconds().median < b.Seconds().median;
                           });
}

double AbResult::LowestStockCost() const {
  double lowest = std::numeric_limits<double>::infinity();
  for (const ContenderRuns& runs : stock) {
    lowest = std::min(lowest, runs.first().final_cost);
  }
  return lowest;
}

double AbResult::LowestCost() const {
  return std::min(ours.first().final_cost, LowestStockCost());
}

Spread AbResult::RatioTo(const ContenderRuns& theirs) const {
  const auto seconds = [](const ContenderRuns& runs) {
    std::vector<double> values;
    for (const SolveRecord& record : runs.rounds) {
      values.push_back(record.seconds);
    }
    return values;
  };
  return SummarizeRatios(seconds(ours), seconds(theirs));
}

double AbResult::RelativeCostDifference() const {
  const double floor =
      std::max(1e-16 * ours.first().initial_cost, std::numeric_limits<double>::min());
  const double reference = std::max(LowestStockCost(), floor);
  return (std::max(ours.first().final_cost, floor) - reference) / reference;
}

Status RunComparison(const Contender& ours, const std::vector<Contender>& stock,
                     const AbOptions& options,
                     const std::function<void(const std::string&)>& announce, AbResult* result) {
  *result = AbResult{};
  RunOutcome warm_up;
  Status status = RunOurs(ours, options.pre_pass_iterations, &warm_up);
  if (!status.ok()) {
    return status;
  }
  const std::vector<Contender> kept = PrePass(stock, options, &result->dropped);
  for (const Dropped& dropped : result->dropped) {
    announce("dropped ceres " + dropped.configuration + ": " + dropped.reason);
  }
  if (!kept.empty()) {
    status = RunRounds(ours, kept, options, announce, result);
  }
  if (status.ok() && result->stock.empty()) {
    const std::string reason =
        result->dropped.empty() ? "none was given" : result->dropped.back().reason;
    return Status::Error(StatusCode::kEvaluationFailed,
                         "no stock configuration solves this problem: " + reason);
  }
  return status;
}

}  // namespace inceres::tools
