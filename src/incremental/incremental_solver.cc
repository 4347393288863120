#include <algorithm>
#include <new>
#include <tuple>
#include <utility>
#include <vector>

#include "base/stopwatch.h"
#include "incremental/active_bounds.h"
#include "incremental/batch_phase.h"
#include "incremental/cached_rows.h"
#include "incremental/incremental_solver_impl.h"
#include "incremental/tuning.h"
#include "incremental/update_context.h"
#include "marginal/marginalize.h"

namespace inceres {

// The solver between its parts: the graph, the batch solver that works on the graph's state, and
// the living system that has values of its own. Whoever moved last has the right values; TakeValues
// brings the graph up to date before the batch solver works on it, and the living system takes them
// back afterwards. The living system is made only when it is needed.
//
// Two kinds of dirty factors are told apart: those that edits have changed, and those that only
// wait (IncrementalSystem::LetDirtyWait) to be linearized where the batch solver has left the
// values. The former decide whether an Update goes to the batch solver again.
//
// After a failure, or when an observer takes an Update back, nothing that was cached survives: the
// values are good, what was computed halfway is not.

using internal::IncrementalMinimizer;
using internal::IncrementalSystem;
using internal::UpdateTrace;

namespace {

// All who look on while an Update works, as one observer: first the table of progress, then the
// user's observer, then the callback of the options. Who ends the Update is the last to be asked.
class UpdateListeners final : public UpdateObserver {
 public:
  // Borrows both for the length of an Update; `observer` may be null.
  UpdateListeners(const IncrementalOptions& options, UpdateObserver* observer)
      : options_(options), observer_(observer) {}

  // What the trace is to ask: null if nobody looks on.
  UpdateObserver* AsObserver() {
    return observer_ != nullptr || options_.progress || options_.callback ? this : nullptr;
  }

  ObserverAction EndOfIteration(const UpdateIteration& iteration) override {
    if (options_.progress) {
      if (iteration.iteration == 0) {
        options_.progress(UpdateProgressHeading());
      }
      options_.progress(ProgressRow(iteration));
    }
    const ObserverAction action =
        observer_ != nullptr ? observer_->EndOfIteration(iteration) : ObserverAction::kContinue;
    return action == ObserverAction::kContinue && options_.callback ? options_.callback(iteration)
                                                                    : action;
  }

 private:
  const IncrementalOptions& options_;
  UpdateObserver* const observer_;
};

// As if newly made, but for the memory it holds.
// Strings and rows keep their capacity, so that a steady stream of Updates does not allocate.
void Clear(UpdateSummary* summary) {
  UpdateSummary cleared;
  cleared.message.swap(summary->message);
  cleared.message.clear();
  cleared.failed_step.swap(summary->failed_step);
  cleared.failed_step.clear();
  cleared.iterations.swap(summary->iterations);
  cleared.iterations.clear();
  *summary = std::move(cleared);
}

// What is added takes nothing from what others know; nor does another loss of a factor that has
// said nothing so far.
bool OnlyAdds(const GraphEdit& edit, const std::vector<internal::IncrementalFamily>& families) {
  const auto is_silent = [&](const std::pair<FactorId, std::shared_ptr<const Loss>>& loss) {
    const FactorId id = loss.first;
    return id.family >= static_cast<FamilyId>(families.size()) ||
           id.index >= families[id.family].num_places() ||
           !families[id.family].weighed().linearized(id.index) ||
           families[id.family].weighed().weight(id.index) == 0.0;
  };
  return edit.removed_variables().empty() && edit.removed_factors().empty() &&
         std::all_of(edit.losses().begin(), edit.losses().end(), is_silent) &&
         edit.measurements().empty() && edit.constants().empty() && edit.new_values().empty() &&
         edit.pins().empty() && edit.bounds().empty();
}

// Whether what has converged by these options has by the others, too: tolerances may be looser, and
// what else a claim rests on is the same.
bool IsAsStrict(const IncrementalOptions& these, const IncrementalOptions& others) {
  const auto rests_on = [](const IncrementalOptions& o) {
    return std::make_tuple(o.min_relative_decrease, o.min_damping, o.claim_damping_share,
                           o.max_damping, o.batch_share, o.batch_strategy, o.damping,
                           o.relinearization, o.relinearization_share, o.relinearization_step,
                           o.max_landmark_refinements);
  };
  return these.function_tolerance <= others.function_tolerance &&
         these.gradient_tolerance <= others.gradient_tolerance &&
         these.parameter_tolerance <= others.parameter_tolerance &&
         these.fixed_cost >= others.fixed_cost && rests_on(these) == rests_on(others);
}

}  // namespace

// The graph's state follows the values held now.
// No-op without a living system: the graph's values are then the ones held.
void IncrementalSolver::Impl::TakeValues() {
  for (VariableId id = 0; live != nullptr && id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id)) {
      graph.SetValues(id, live->variables().current(id));
    }
  }
}

void IncrementalSolver::Impl::Form() {
  if (live == nullptr) {
    Restart();
    // All factors are dirty in a system that was just made. They are nothing new if the batch
    // solver has been there.
    if (std::exchange(in_batch_, false)) {
      live->LetDirtyWait();
    }
  }
}

// A new system from the values held now: nothing cached survives.
void IncrementalSolver::Impl::Restart() {
  TakeValues();
  // It is a factor of the old system's S.
  undamped_ = nullptr;
  weakest_.is_known = false;
  live = std::make_unique<IncrementalSystem>(graph, options_.num_threads, tuning_);
  minimizer_ = std::make_unique<IncrementalMinimizer>(options_, tuning_, live.get());
  // Variables first, since factors look their rows up; then families in their order, so that rows
  // and sums do not depend on how the graph came to be.
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id)) {
      live->AddVariable(id);
    }
  }
  for (FamilyId family = 0; family < graph.num_families(); ++family) {
    for (int i = 0; i < graph.NumFactors(family); ++i) {
      if (graph.HasFactor(family, i)) {
        live->AddFactor({family, i});
      }
    }
  }
  // Everything is new here; steps of new frames are for those that come to others.
  live->ForgetNewFrames();
}

void IncrementalSolver::Impl::SetOptions(const IncrementalOptions& options) {
  const bool claims_hold = IsAsStrict(options_, options);
  converged_ = converged_ && claims_hold;
  IncrementalOptions taken = options;
  // Threads and the reduced solver belong to what was built by the constructor.
  taken.num_threads = options_.num_threads;
  taken.reduced_solver = options_.reduced_solver;
  taken.reduced_solver_factory = options_.reduced_solver_factory;
  options_ = std::move(taken);
  valid_ = options_.Validate();
  if (live != nullptr) {
    minimizer_->SetOptions(options_, claims_hold);
  }
}

// Before the first Update only the graph follows: a problem that is solved once needs no more.
// Later edits are followed by difference.
Status IncrementalSolver::Impl::Apply(const GraphEdit& edit) {
  Status status = valid_;
  bool only_adds = false;
  if (status.ok() && (begun_ || live != nullptr)) {
    Form();
    only_adds = weakest_.is_known && OnlyAdds(edit, live->families());
    status = live->Apply(edit);
  } else if (status.ok()) {
    status = internal::ActiveBounds::Check(edit);
    status = status.ok() ? graph.Apply(edit) : status;
  }
  // An edit that was refused has changed nothing.
  if (!edit.empty() && status.ok()) {
    converged_ = false;
    edited_ = true;
    weakest_.is_known = only_adds;
  }
  return status;
}

// Cached rows serve where their old linearizations err by less than the limit, which is the first
// one of "Relinearization" with the smaller share: what marginalization keeps is final.
MarginalizationSummary IncrementalSolver::Impl::Marginalize(const MarginalizationRequest& request,
                                                            const MarginalizationOptions& options) {
  MarginalizationSummary refused;
  refused.status = valid_;
  if (!refused.status.ok()) {
    return refused;
  }
  Form();
  const double share = std::min(
      internal::SharesOf(options_, live->schur().structure().num_landmarks()).relinearization,
      tuning_.relinearize.refresh_share);
  internal::CachedRows cached(*live, share * 2.0 * options_.function_tolerance *
                                         std::max(cost_ - options_.fixed_cost, 0.0) /
                                         std::max(1, graph.num_factors()));
  internal::MarginalizationTarget target;
  target.graph = &graph;
  // The values of the living system, for the graph's may be older.
  target.values = [this](VariableId id) { return live->variables().current(id); };
  target.cached = [&](FactorId id, const auto& wanted, internal::LinearizedFactor* rows) {
    return cached.Find(id, wanted, rows);
  };
  target.apply = [this](const GraphEdit& edit) { return Apply(edit); };
  return internal::MarginalizeOn(target, request, options);
}

// The graph's state is where the batch solver works; the incremental system then starts from what
// it found. True if nothing is left to do.
// The values go both ways: into the graph before, and into the living system, if there is one,
// after.
bool IncrementalSolver::Impl::SolveInBatch(UpdateTrace* trace) {
  TakeValues();
  // Holds nothing for a next call: what is kept from one Update to the next is the living system.
  Solver solver(/*max_bytes=*/0);
  const internal::BatchOutcome outcome =
      internal::RunPart({&options_, tuning_.batch, internal::BatchEnd::kHandsOver, stop, &solver,
                         &graph, &shown_state_, trace});
  trace->summary().termination = outcome.termination;
  held_back_ = outcome.held_back;
  if (outcome.termination != Termination::kFailure) {
    cost_ = trace->summary().final_cost;
  }
  if (live == nullptr) {
    in_batch_ = true;
    return outcome.finished;
  }
  // Where all factors are dirty nothing cached is lost by new values; else the system is made anew.
  if (live->NumDirtyFactors() == graph.num_factors()) {
    live->TakeValues();
  } else {
    undamped_ = nullptr;
    live.reset();
    Restart();
  }
  live->LetDirtyWait();
  return outcome.finished;
}

void IncrementalSolver::Impl::Update(UpdateSummary* summary, UpdateObserver* observer) {
  Clear(summary);
  UpdateListeners listeners(options_, observer);
  UpdateTrace trace(listeners.AsObserver(), summary);
  if (!valid_.ok()) {
    summary->message = valid_.message;
    return;
  }
  // Without an edit since, the same Update would find the same.
  if (converged_) {
    changed_rows_.clear();
    summary->termination = Termination::kConvergence;
    summary->message = "Nothing has changed since the last Update converged.";
    summary->initial_cost = cost_;
    trace.EndRow(cost_);
  } else {
    MinimizeOrPutBack(&trace);
    changed_rows_.clear();
    if (live != nullptr) {
      live->schur().changes().TakeRowsOfS(&changed_rows_);
    }
    converged_ = summary->termination == Termination::kConvergence && !held_back_;
    // S and b are incomplete after a failed linearization.
    if (summary->termination == Termination::kFailure && live != nullptr) {
      Restart();
    } else if (summary->termination == Termination::kUserFailure) {
      Abandon(summary->initial_cost, &trace);
    }
    // there is no factor to take covariances from
    edited_ = !summary->IsSolutionUsable();
    summary->bytes = live != nullptr ? live->Bytes() + minimizer_->Bytes() : 0;
  }
  stop = false;  // it was for this Update, whatever came of it
  summary->final_cost = cost_;
  summary->num_undetermined_landmarks =
      live != nullptr ? live->schur().blocks().num_undetermined() : 0;
  summary->seconds = internal::NowInSeconds() - trace.start_seconds();
}

// What the user's code throws passes through. With an observer the values and the cost are those
// of before; else those of the last step that was taken, for which no copy is needed.
void IncrementalSolver::Impl::MinimizeOrPutBack(UpdateTrace* trace) {
  const double start_cost = cost_;
  if (trace->observed()) {
    TakeValues();
    start_state_ = graph.state();
  }
  try {
    Minimize(trace);
  } catch (const std::bad_alloc&) {
    Abandon(start_cost, trace);
    trace->summary().termination = Termination::kFailure;
    trace->summary().message = "Out of memory.";
  } catch (...) {
    Abandon(start_cost, trace);
    throw;
  }
}

// As if nothing had ever been computed for the values that stay, which no batch solver has touched.
void IncrementalSolver::Impl::Abandon(double start_cost, UpdateTrace* trace) {
  shown_state_ = nullptr;
  stop = held_back_ = false;
  if (trace->observed()) {
    cost_ = start_cost;
    graph.mutable_state() = start_state_;
  } else {
    TakeValues();
    const auto& rows = trace->summary().iterations;
    cost_ = !rows.empty() && rows.back().step != UpdateStep::kBatch ? rows.back().cost : cost_;
  }
  undamped_ = nullptr;
  live.reset();
  edited_ = true;
  in_batch_ = false;
}

void IncrementalSolver::Impl::Minimize(UpdateTrace* trace) {
  // Factors that only wait to be linearized where the batch solver left them are nothing new.
  // Without a living system all are new, unless the batch solver has just left them.
  const double num_new = live != nullptr ? live->NumDirtyFactors() - live->NumWaitingFactors() +
                                               live->NumReweighedFactors()
                         : in_batch_ ? 0
                                     : graph.num_factors();
  begun_ = true;
  const bool batch_only = options_.batch_share == 0.0;
  // The batch solver wins when most of the system would be replaced.
  const bool batch = (batch_only || num_new > options_.batch_share * graph.num_factors()) &&
                     internal::TakesBatchPhase(graph);
  bool finished = false;
  if (batch) {
    finished = SolveInBatch(trace) || batch_only;
    // Its steps are those of the free problem, clamped: it may creep along a bound and call that
    // convergence.
    finished = finished && (batch_only || !graph.HasBounds() ||
                            trace->summary().termination != Termination::kConvergence);
  }
  // Where the batch solver fails the state is what it was: the other one gets its chance, or names
  // the culprit.
  if (!finished) {
    held_back_ = false;
    Form();
    const std::size_t rows_before = trace->summary().iterations.size();
    // A batch phase has brought the values near the minimum, however new the factors are.
    minimizer_->Minimize(!batch && num_new > tuning_.rebuild.mostly_new * graph.num_factors(), stop,
                         trace);
    // A system that is made now asks nobody for Jacobians by its constants, which may be what
    // failed.
    if (trace->summary().termination == Termination::kFailure && live->HasHeldVariables()) {
      Restart();
      minimizer_->Minimize(/*mostly_new=*/false, stop, trace);
    }
    // No row was written: not even the start has a cost.
    const bool failed_at_once = trace->summary().termination == Termination::kFailure &&
                                trace->summary().iterations.size() == rows_before;
    cost_ = failed_at_once ? cost_ : live->cost();  // what could not be evaluated has no cost
  }
}

IncrementalSolver::IncrementalSolver(const IncrementalOptions& options)
    : impl_(std::make_unique<Impl>(options)) {
}
IncrementalSolver::~IncrementalSolver() = default;

const FactorGraph& IncrementalSolver::graph() const {
  return impl_->graph;
}

FamilyId IncrementalSolver::AddFamily(std::shared_ptr<const FactorFamily> family) {
  return impl_->graph.AddFamily(std::move(family));
}

void IncrementalSolver::SetVariableNames(std::function<std::string(VariableId)> name_of) {
  impl_->graph.SetVariableNames(std::move(name_of));
}

void IncrementalSolver::SetOptions(const IncrementalOptions& options) {
  impl_->SetOptions(options);
}

Status IncrementalSolver::Apply(const GraphEdit& edit) {
  return impl_->Apply(edit);
}

MarginalizationSummary IncrementalSolver::Marginalize(const MarginalizationRequest& request,
                                                      const MarginalizationOptions& options) {
  return impl_->Marginalize(request, options);
}

UpdateSummary IncrementalSolver::Update() {
  UpdateSummary summary;
  Update(&summary);
  return summary;
}

// Readers of snapshots see an Update's outcome as a whole, also after a failure.
void IncrementalSolver::Update(UpdateSummary* summary, UpdateObserver* observer) {
  impl_->Update(summary, observer);
  impl_->PublishSnapshot(summary->termination);
}

bool IncrementalSolver::ReadSnapshot(ValueSnapshot* snapshot) const {
  return impl_->ReadSnapshot(snapshot);
}

void IncrementalSolver::RequestStop() {
  impl_->stop = true;
}

const double* IncrementalSolver::Values(VariableId id) const {
  return impl_->Values(id);
}

ReducedStructure IncrementalSolver::Structure() const {
  return impl_->Structure();
}

Status IncrementalSolver::Covariance(const std::vector<VariableId>& ids,
                                     const LiveCovarianceOptions& options,
                                     LiveCovariance* covariance) const {
  return impl_->Covariance(ids, options, covariance);
}

double IncrementalSolver::cost() const {
  return impl_->cost();
}

}  // namespace inceres
