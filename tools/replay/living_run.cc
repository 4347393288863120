#include "tools/replay/living_run.h"

#include <cstddef>
#include <memory>

#include "src/base/stopwatch.h"
#include "tools/replay/replay_report.h"

namespace inceres::tools {
namespace {

Status AddSteps(const ReplayScript& script, std::size_t begin, std::size_t end,
                ReplayCeresProblem* problem) {
  for (std::size_t i = begin; i < end; ++i) {
    if (Status status = problem->Add(script.steps[i]); !status.ok()) {
      status.message = "step " + std::to_string(i + 1) + ": " + status.message;
      return status;
    }
  }
  return Status::Ok();
}

std::size_t NumParameters(const ReplayScript& script, std::size_t num_steps) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < num_steps; ++i) {
    for (const ReplayVariable& variable : script.steps[i].variables) {
      count += static_cast<std::size_t>(AmbientSize(variable.kind));
    }
  }
  return count;
}

// The seconds that a run took, whatever its outcome.
template <typename Run>
Status Time(const Run& run, LivingReport* report) {
  Status status;
  report->total_seconds = internal::SecondsOf([&] { status = run(); });
  return status;
}

void Tell(const OnLivingSolve& on_solve, std::size_t solve, std::size_t num_solves) {
  if (on_solve != nullptr) {
    on_solve(solve, num_solves);
  }
}

Status GrowOne(const ReplayScript& script, std::size_t count, const ReplaySettings& settings,
               const CeresSolveFunction& solve, const OnLivingSolve& on_solve,
               LivingReport* report) {
  ReplayCeresProblem living(settings.autodiff);
  for (std::size_t i = 0; i < count; ++i) {
    if (Status status = AddSteps(script, i, i + 1, &living); !status.ok()) {
      return status;
    }
    report->solves.push_back(SolveGrowing(settings, &living, solve));
    Tell(on_solve, i + 1, count);
  }
  return Status::Ok();
}

// Steps before the last are added over arrays that are then set back to what they had come to: only
// from there does the last one begin.
Status BuildEach(const ReplayScript& script, std::size_t count, const ReplaySettings& settings,
                 const CeresSolveFunction& solve, const OnLivingSolve& on_solve,
                 LivingReport* report) {
  std::vector<double> parameters(NumParameters(script, count));
  std::vector<double> state;
  for (std::size_t i = 0; i < count; ++i) {
    ReplayCeresProblem rebuilt(settings.autodiff, parameters.data());
    Status status = AddSteps(script, 0, i, &rebuilt);
    rebuilt.SetState(state);
    status = status.ok() ? AddSteps(script, i, i + 1, &rebuilt) : status;
    if (!status.ok()) {
      return status;
    }
    report->solves.push_back(SolveGrowing(settings, &rebuilt, solve));
    Tell(on_solve, i + 1, count);
    state = rebuilt.State();
  }
  return Status::Ok();
}

nlohmann::json ToJson(const ReplayOutcome& solve, std::size_t number) {
  return {{"step", number},
          {"ms", 1e3 * solve.seconds},
          {"initial_cost", solve.initial_cost},
          {"cost", solve.final_cost},
          {"iterations", solve.iterations},
          {"usable", solve.usable},
          {"termination", solve.termination},
          {"message", solve.message}};
}

}  // namespace

Status PlayLiving(const ReplayScript& script, int max_steps, const ReplaySettings& settings,
                  LivingMode mode, const CeresSolveFunction& solve, LivingReport* report,
                  const OnLivingSolve& on_solve) {
  const auto play = mode == LivingMode::kPlain ? GrowOne : BuildEach;
  return Time(
      [&] { return play(script, NumSteps(script, max_steps), settings, solve, on_solve, report); },
      report);
}

Status PlayAtOnce(const ReplayScript& script, int max_steps, const ReplaySettings& settings,
                  const CeresSolveFunction& solve, LivingReport* report) {
  return Time(
      [&] {
        ReplayCeresProblem whole(settings.autodiff);
        Status status = AddSteps(script, 0, NumSteps(script, max_steps), &whole);
        if (status.ok()) {
          report->solves.push_back(SolveGrowing(settings, &whole, solve));
        }
        return status;
      },
      report);
}

Status PlayAtOnce(const ProblemSource& source, const LossSpec& loss, const ReplaySettings& settings,
                  const CeresSolveFunction& solve, LivingReport* report) {
  return Time(
      [&] {
        ProblemSource::CeresInstance instance;
        Status status = source.MakeCeresInstance(loss, &instance);
        if (status.ok()) {
          report->solves.push_back(TimeCeresSolve(CeresOptions(settings, instance.landmarks_first),
                                                  instance.problem.get(), solve));
        }
        return status;
      },
      report);
}

nlohmann::json ToJson(const LivingReport& report) {
  nlohmann::json solves = nlohmann::json::array();
  std::vector<double> ms;
  double cost_sum = 0.0;
  for (std::size_t i = 0; i < report.solves.size(); ++i) {
    solves.push_back(ToJson(report.solves[i], i + 1));
    ms.push_back(1e3 * report.solves[i].seconds);
    cost_sum += report.solves[i].final_cost;
  }
  return {{"solves", solves},
          {"solve_ms", ToJson(LatencyOf(ms))},
          {"total_s", report.total_seconds},
          {"final_cost", report.solves.back().final_cost},
          {"final_cost_sum", cost_sum}};
}

}  // namespace inceres::tools
