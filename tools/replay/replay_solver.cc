#include "tools/replay/replay_solver.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "inceres/ceres/solve.h"
#include "inceres/solver/gnc.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "src/base/stopwatch.h"
#include "tools/replay/replay_ceres_problem.h"
#include "tools/replay/replay_ceres_solve.h"
#include "tools/replay/replay_graph.h"

namespace inceres::tools {
namespace {

using internal::SecondsOf;

SolverOptions CoreOptions(const ReplaySettings& settings) {
  SolverOptions options;
  options.strategy = settings.dogleg ? TrustRegionStrategyKind::kDogleg
                                     : TrustRegionStrategyKind::kLevenbergMarquardt;
  options.num_threads = settings.num_threads;
  options.max_num_iterations = settings.max_num_iterations;
  options.function_tolerance = settings.function_tolerance;
  options.gradient_tolerance = settings.gradient_tolerance;
  options.parameter_tolerance = settings.parameter_tolerance;
  return options;
}

// Iterations whose linear solve or evaluation failed; iteration 0 is the start.
template <typename Iterations>
std::int64_t CountInvalidSteps(const Iterations& iterations) {
  std::int64_t count = 0;
  for (std::size_t i = 1; i < iterations.size(); ++i) {
    count += iterations[i].step_is_valid ? 0 : 1;
  }
  return count;
}

ReplayOutcome OutcomeOf(const Summary& summary, double seconds) {
  ReplayOutcome outcome;
  outcome.usable = summary.IsSolutionUsable();
  outcome.termination = ToString(summary.termination);
  outcome.message =
      outcome.usable ? "" : summary.message + (summary.detail.empty() ? "" : ": " + summary.detail);
  outcome.seconds = seconds;
  outcome.initial_cost = summary.initial_cost;
  outcome.final_cost = summary.final_cost;
  outcome.iterations = std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  outcome.work = {{"residual_evaluations", summary.work.num_residual_evaluations},
                  {"jacobian_evaluations", summary.work.num_jacobian_evaluations},
                  {"linear_solves", summary.work.num_linear_solves},
                  {"unsuccessful_steps", summary.num_unsuccessful_steps},
                  {"invalid_steps", CountInvalidSteps(summary.iterations)},
                  {"schur_products", summary.work.num_schur_products},
                  {"bytes", summary.work.bytes}};
  return outcome;
}

std::string Describe(const ReplaySettings& settings) {
  return std::string(settings.dogleg ? "Dog-Leg" : "LM") + ", " +
         (settings.autodiff ? "AutoDiff" : "analytic factors");
}

// A ceres::Problem solved by stock Ceres or by the shim.
class CeresReplaySolver : public ReplaySolver {
 public:
  CeresReplaySolver(const ReplaySettings& settings, bool shim)
      : settings_(settings), shim_(shim), living_(settings.autodiff) {}

  std::string Name() const override {
    return (shim_ ? "inceres (exact, ceres::Problem)"
                  : "Ceres (" + DescribeLinearSolver(settings_.linear_solver) + ")") +
           ", " + Describe(settings_);
  }
  Status AddStep(const ReplayStep& step) override { return living_.Add(step); }

  ReplayOutcome Solve() override {
    if (!shim_) {
      return SolveGrowing(settings_, &living_, PlainCeresSolve);
    }
    SolveOptions strict;
    strict.strict = true;
    return SolveGrowing(settings_, &living_,
                        [&strict](const ceres::Solver::Options& options, ceres::Problem* problem,
                                  ceres::Solver::Summary* summary) {
                          inceres::Solve(options, problem, summary, strict);
                        });
  }

  std::vector<double> State() const override { return living_.State(); }

 private:
  const ReplaySettings settings_;
  const bool shim_;
  ReplayCeresProblem living_;
};

// A factor graph of built-in factors solved by the core.
class CoreReplaySolver : public ReplaySolver {
 public:
  explicit CoreReplaySolver(const ReplaySettings& settings) : settings_(settings), living_(false) {}

  std::string Name() const override {
    return "inceres (exact, factor graph), " + Describe(settings_);
  }
  Status AddStep(const ReplayStep& step) override { return living_.Add(step, &graph_); }
  ReplayOutcome Solve() override {
    Summary summary;
    const double seconds =
        SecondsOf([&] { summary = inceres::Solve(CoreOptions(settings_), &graph_); });
    return OutcomeOf(summary, seconds);
  }
  std::vector<double> State() const override { return graph_.state(); }
  bool StartFrom(const std::vector<double>& state) override {
    graph_.mutable_state() = state;
    return true;
  }

 private:
  const ReplaySettings settings_;
  FactorGraph graph_;
  ReplayGraph living_;
};

// The same graph in the solver that remembers.
class IncrementalReplaySolver : public ReplaySolver {
 public:
  explicit IncrementalReplaySolver(const ReplaySettings& settings)
      : autodiff_(settings.autodiff),
        with_gnc_(settings.gnc),
        with_covariance_(settings.covariance),
        solver_(Options(settings)),
        living_(settings.autodiff),
        gnc_(GncOptions(), &solver_) {}

  std::string Name() const override {
    return std::string("inceres (incremental, factor graph), ") +
           (autodiff_ ? "AutoDiff" : "analytic factors") + (with_gnc_ ? ", GNC" : "");
  }
  Status AddStep(const ReplayStep& step) override {
    Status status = living_.AddAsEdit(
        step, solver_.graph(), [this](VariableId id) { return solver_.Values(id); },
        [this](auto family) { return solver_.AddFamily(std::move(family)); },
        [this](const GraphEdit& edit) { return solver_.Apply(edit); });
    for (const auto& [id, is_wrong] : living_.new_suspects()) {
      if (with_gnc_ && status.ok()) {
        gnc_.Watch(id);
        is_wrong_.push_back(is_wrong);
      }
    }
    return status;
  }
  ReplayOutcome Solve() override {
    if (with_gnc_) {
      return SolveRobustly();
    }
    UpdateSummary summary;
    ReplayOutcome outcome;
    outcome.seconds = SecondsOf([&] { summary = solver_.Update(); });
    WriteEnd(summary, &outcome);
    outcome.work = {{"rejected_steps", summary.num_unsuccessful_steps},
                    {"relinearised_factors", summary.num_relinearized_factors},
                    {"evaluated_factors", summary.num_evaluated_factors},
                    {"eliminated_landmarks", summary.num_eliminated_landmarks},
                    {"factored_rows", summary.num_factored_rows},
                    {"reorderings", summary.num_reorderings},
                    {"updated_landmarks", summary.num_updated_landmarks},
                    {"solved_rows", summary.num_solved_rows},
                    {"visited_landmarks", summary.num_visited_landmarks},
                    {"moved_frames", summary.num_moved_frames},
                    {"rebuilds", summary.num_rebuilds},
                    {"bytes", summary.bytes}};
    if (with_covariance_) {
      TakeCovariances(&outcome);
    }
    return outcome;
  }
  std::vector<double> State() const override {
    std::vector<double> state;
    const FactorGraph& graph = solver_.graph();
    for (VariableId id = 0; id < graph.num_variables(); ++id) {
      state.insert(state.end(), solver_.Values(id), solver_.Values(id) + graph.AmbientSize(id));
    }
    return state;
  }
  std::optional<ReducedStructure> Structure() const override { return solver_.Structure(); }

 private:
  // What an Update and one with graduated non-convexity tell alike.
  template <typename AnySummary>
  static void WriteEnd(const AnySummary& summary, ReplayOutcome* outcome) {
    outcome->usable = summary.IsSolutionUsable();
    outcome->termination = ToString(summary.termination);
    outcome->message = outcome->usable ? "" : summary.message;
    outcome->initial_cost = summary.initial_cost;
    outcome->final_cost = summary.final_cost;
    outcome->iterations = summary.num_iterations;
  }

  // Of the newest frame, and of one that came anywhere before, in nanoseconds. A step without
  // either has no entry.
  void TakeCovariances(ReplayOutcome* outcome) {
    const FactorGraph& graph = solver_.graph();
    VariableId newest = -1;
    for (VariableId id = 0; id < graph.num_variables(); ++id) {
      newest = graph.HasVariable(id) && graph.role(id) == Role::kFrame ? id : newest;
    }
    if (newest < 0) {
      return;
    }
    std::vector<std::pair<const char*, VariableId>> asked = {{"newest", newest}};
    if (const auto any = static_cast<VariableId>(7919LL * newest % (newest + 1)); any != newest) {
      asked.emplace_back("any", any);
    }
    LiveCovariance covariance;
    for (const auto& one : asked) {
      Status status;
      const double seconds =
          SecondsOf([&] { status = solver_.MarginalCovariance(one.second, {}, &covariance); });
      if (status.ok() && covariance.size() > 0) {
        outcome->work.emplace_back(std::string("covariance_ns_") + one.first,
                                   static_cast<std::int64_t>(1e9 * seconds));
      }
    }
  }

  // Verdicts come in the order in which suspects were watched.
  ReplayOutcome SolveRobustly() {
    GncSummary summary;
    ReplayOutcome outcome;
    outcome.seconds = SecondsOf([&] { summary = gnc_.Update(); });
    WriteEnd(summary, &outcome);
    std::int64_t num_relinearized = 0, num_wrong = 0, num_found = 0, num_lost = 0;
    for (const GncRound& round : summary.rounds) {
      num_relinearized += round.num_relinearized_factors;
    }
    for (std::size_t k = 0; k < summary.verdicts.size(); ++k) {
      const bool out = !summary.verdicts[k].inlier;
      num_wrong += is_wrong_[k] ? 1 : 0;
      num_found += is_wrong_[k] && out ? 1 : 0;
      num_lost += !is_wrong_[k] && out ? 1 : 0;
    }
    outcome.work = {{"rounds", static_cast<std::int64_t>(summary.rounds.size())},
                    {"relinearised_factors", num_relinearized},
                    {"num_suspects", static_cast<std::int64_t>(summary.verdicts.size())},
                    {"num_wrong", num_wrong},
                    {"num_wrong_found", num_found},
                    {"num_right_lost", num_lost}};
    return outcome;
  }

  static IncrementalOptions Options(const ReplaySettings& settings) {
    IncrementalOptions options;
    options.max_num_iterations = settings.max_num_iterations;
    options.function_tolerance = settings.function_tolerance;
    options.num_threads = settings.num_threads;
    return options;
  }

  const bool autodiff_;
  const bool with_gnc_;
  const bool with_covariance_;
  IncrementalSolver solver_;
  ReplayGraph living_;
  LivingGnc gnc_;
  std::vector<bool> is_wrong_;  // of what it watches
};

}  // namespace

std::unique_ptr<ReplaySolver> MakeStockReplaySolver(const ReplaySettings& settings) {
  return std::make_unique<CeresReplaySolver>(settings, false);
}

std::unique_ptr<ReplaySolver> MakeExactReplaySolver(const ReplaySettings& settings) {
  if (settings.autodiff) {
    return std::make_unique<CeresReplaySolver>(settings, true);
  }
  return std::make_unique<CoreReplaySolver>(settings);
}

std::unique_ptr<ReplaySolver> MakeIncrementalReplaySolver(const ReplaySettings& settings) {
  return std::make_unique<IncrementalReplaySolver>(settings);
}

struct ReplayReference::Impl {
  explicit Impl(const ReplaySettings& ours) : settings(ours), living(ours.autodiff) {
    settings.dogleg = false;
    settings.max_num_iterations = 500;
    settings.function_tolerance = settings.gradient_tolerance = settings.parameter_tolerance =
        1e-12;
  }

  ReplaySettings settings;
  ReplayCeresProblem living;
};

ReplayReference::ReplayReference(const ReplaySettings& settings)
    : impl_(std::make_unique<Impl>(settings)) {
}

ReplayReference::~ReplayReference() = default;

Status ReplayReference::AddStep(const ReplayStep& step) {
  return impl_->living.Add(step);
}

double ReplayReference::CostAt(const std::vector<double>& state) {
  impl_->living.SetState(state);
  double cost = 0.0;
  const bool evaluated = impl_->living.problem()->Evaluate(ceres::Problem::EvaluateOptions(), &cost,
                                                           nullptr, nullptr, nullptr);
  return evaluated ? cost : std::numeric_limits<double>::quiet_NaN();
}

ReplayOutcome ReplayReference::MinimumFrom(const std::vector<double>& state) {
  impl_->living.SetState(state);
  return SolveGrowing(impl_->settings, &impl_->living, PlainCeresSolve);
}

}  // namespace inceres::tools
