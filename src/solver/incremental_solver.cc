#include "inceres/solver/incremental_solver.h"

#include <atomic>
#include <vector>

#include "base/stopwatch.h"
#include "solver/incremental_minimizer.h"

namespace inceres {

using internal::IncrementalMinimizer;
using internal::LiveSystem;

class IncrementalSolver::Impl {
 public:
  explicit Impl(const IncrementalOptions& options) : options_(options) {
    if (options_.Validate().ok()) {
      Restart();
    }
  }

  void SetOptions(const IncrementalOptions& options);
  Status Apply(const GraphEdit& edit);
  UpdateSummary Update();

  FactorGraph graph;
  std::unique_ptr<LiveSystem> live;
  std::atomic<bool> stop{false};

 private:
  void Restart();

  IncrementalOptions options_;
  std::unique_ptr<IncrementalMinimizer> minimizer_;
  bool converged_ = false;  // and nothing edited since
};

// A new system from the values held now: nothing cached survives.
void IncrementalSolver::Impl::Restart() {
  const auto old = std::move(live);
  live = std::make_unique<LiveSystem>(graph, options_.num_threads);
  minimizer_ = std::make_unique<IncrementalMinimizer>(options_, live.get());
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    if (graph.HasVariable(id)) {
      if (old != nullptr) {
        graph.SetValues(id, old->values().current(id));
      }
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
}

void IncrementalSolver::Impl::SetOptions(const IncrementalOptions& options) {
  converged_ = converged_ && options.function_tolerance >= options_.function_tolerance;
  const int num_threads = options_.num_threads;  // of the live system
  options_ = options;
  options_.num_threads = num_threads;
  if (live == nullptr && options_.Validate().ok()) {
    Restart();  // the options given first were not valid
  } else if (live != nullptr) {
    minimizer_->SetOptions(options_);
  }
}

Status IncrementalSolver::Impl::Apply(const GraphEdit& edit) {
  Status status = options_.Validate();
  if (status.ok()) {
    status = live->Apply(edit);
  }
  converged_ = converged_ && (edit.empty() || !status.ok());
  return status;
}

UpdateSummary IncrementalSolver::Impl::Update() {
  const double start = internal::NowInSeconds();
  UpdateSummary summary;
  const Status valid = options_.Validate();
  if (!valid.ok()) {
    summary.message = valid.message;
    return summary;
  }
  if (converged_) {
    summary.termination = Termination::kConvergence;
    summary.message = "Nothing has changed since the last Update converged.";
    summary.initial_cost = summary.final_cost = live->cost();
    summary.num_parked_landmarks = live->schur().num_parked();
    summary.seconds = internal::NowInSeconds() - start;
    return summary;
  }
  minimizer_->Minimize(start, stop, &summary);
  stop = false;
  converged_ = summary.termination == Termination::kConvergence;
  if (summary.termination == Termination::kFailure) {
    Restart();
  }
  summary.final_cost = live->cost();
  summary.num_parked_landmarks = live->schur().num_parked();
  summary.seconds = internal::NowInSeconds() - start;
  return summary;
}

IncrementalSolver::IncrementalSolver(const IncrementalOptions& options) : impl_(std::make_unique<Impl>(options)) {
}
IncrementalSolver::~IncrementalSolver() = default;

const FactorGraph& IncrementalSolver::graph() const {
  return impl_->graph;
}

FamilyId IncrementalSolver::AddFamily(std::shared_ptr<const FactorFamily> family) {
  return impl_->graph.AddFamily(std::move(family));
}

void IncrementalSolver::SetOptions(const IncrementalOptions& options) {
  impl_->SetOptions(options);
}

Status IncrementalSolver::Apply(const GraphEdit& edit) {
  return impl_->Apply(edit);
}

UpdateSummary IncrementalSolver::Update() {
  return impl_->Update();
}

void IncrementalSolver::RequestStop() {
  impl_->stop = true;
}

const double* IncrementalSolver::Values(VariableId id) const {
  return impl_->live->values().current(id);
}

double IncrementalSolver::cost() const {
  return impl_->live->cost();
}

}  // namespace inceres
