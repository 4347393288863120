#include "incremental/frame_step.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/stopwatch.h"
#include "linear/not_positive_definite.h"
#include "linear/select_solver.h"

namespace inceres::internal {

// The step of the frames, (S + μ diag C) δ_c = b, kept between iterations (docs/algorithms.md,
// "Lazy steps"). values_ is the part of δ_c that is still to take: what was applied is subtracted,
// and b changes by as much, so that rows nothing has reached need no new solution. The solver is
// told three kinds of change, each once: rows of S since it last factored, entries of b since it
// last substituted, and a pattern of another version, which it has to analyze. A change of μ
// touches no block but the whole diagonal, so everything counts as changed then.

namespace {

// One past the last row where nothing has changed.
int FirstOf(const std::vector<std::int32_t>& ascending_rows, const IncrementalSchur& schur) {
  return ascending_rows.empty() ? schur.S().num_rows() : ascending_rows.front();
}

// Solvers that do all of it do not count.
int CountOf(int rows, const IncrementalSchur& schur) {
  return rows == ReducedSolver::Work::kAll ? schur.structure().num_frames() : rows;
}

}  // namespace

// A solver that can tell ½ bᵀA⁻¹b before the backward substitution is asked for that first; others
// are not HalfSolves.
FrameStep::FrameStep(UpdateContext* context)
    : context_(*context),
      solver_(MakeResumingSolver(context->options.reduced_solver,
                                 context->options.reduced_solver_factory, PcgOptions(),
                                 context->system.executor())),
      half_solves_(dynamic_cast<HalfSolves*>(solver_.get())) {
}

// A share of T for all frames together, so that what the substitution leaves stays below it.
double FrameStep::Wildfire() const {
  return context_.tuning.truncate.wildfire_share * context_.Tolerance() /
         std::max(1, context_.system.schur().structure().num_frames());
}

// S and b as they are now, factored with the damping of now. Counts go to the summary, also after a
// failure.
Status FrameStep::Factorize() {
  UpdateSummary& summary = *context_.summary;
  const StageTimer timer(&summary.solve_seconds);
  // An earlier factor is asked only as long as μ is still that of the factor.
  mu_of_update_ = context_.control.mu();
  if (solver_ == nullptr) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "IncrementalOptions::reduced_solver_factory returned null");
  }
  IncrementalSchur& schur = context_.system.schur();
  // Follows b, weights and damping; the rows of S that the factor has not seen are another list.
  Refresh();
  // Rows at the end begin with a step of zero.
  values_.resize(schur.size(), 0.0);
  schur.changes().TakeUnfactored(&changed_rows_);
  work_ = ReducedSolver::Work();
  context_.row().linear_solver_iterations = 1;
  if (schur.size() == 0) {
    all_changed_ = true;  // the solver has not seen them go
    return Status::Ok();
  }
  const Status factored = AnalyzeAndFactorize();
  work_ = solver_->work();
  summary.num_factored_rows += CountOf(work_.factored_rows, schur);
  summary.num_reorderings += work_.reorderings;
  return factored;
}

// What the model promises for the whole step is known from the forward substitution alone, where
// the solver can say so: R = ½ yᵀy with y = L⁻¹b, and the landmarks' part. The changes of b are
// taken up by that, so Solve is told of later ones only.
bool FrameStep::SeesLeft(double landmark_gain) {
  const StageTimer timer(&context_.summary->solve_seconds);
  IncrementalSchur& schur = context_.system.schur();
  double gain = 0.0;
  bool sees = false;
  if (half_solves_ != nullptr && schur.size() > 0) {
    schur.changes().TakeUnsolved(&changed_rows_);
    const ReducedSolver::Rows changed_b{FirstOf(changed_rows_, schur), &changed_rows_};
    sees = half_solves_->SolveForGain(reduced_.b().data(), changed_b, &gain).ok();
  }
  context_.summary->remaining_decrease = landmark_gain + gain;
  return sees;
}

Status FrameStep::Solve() {
  UpdateSummary& summary = *context_.summary;
  const StageTimer timer(&summary.solve_seconds);
  IncrementalSchur& schur = context_.system.schur();
  if (schur.size() == 0) {
    return Status::Ok();
  }
  schur.changes().TakeUnsolved(&changed_rows_);
  const ReducedSolver::Rows changed_b{FirstOf(changed_rows_, schur), &changed_rows_};
  // values_ goes in as the last solution less what was applied, comes out as the new one; a row
  // whose change Σ C_kk Δ_k² is no more than Wildfire is not passed on.
  const Status solved = solver_->Solve(reduced_.b().data(), changed_b,
                                       {reduced_.weights().data(), Wildfire()}, values_.data());
  work_ = solver_->work();
  summary.num_solved_rows += CountOf(work_.solved_rows, schur);
  summary.num_pcg_iterations += work_.iterations;
  context_.row().linear_solver_iterations = std::max(1, work_.iterations);
  return solved;
}

// Nothing of a step is asked for.
Status FrameStep::FactorizeWith(double mu) {
  IncrementalSchur& schur = context_.system.schur();
  if (solver_ == nullptr || schur.size() == 0) {
    return Status::Ok();
  }
  Follow(mu);
  values_.resize(schur.size(), 0.0);
  schur.changes().TakeUnfactored(&changed_rows_);
  return AnalyzeAndFactorize();
}

// A factor that failed is none, whatever was there before: HasFactor must not offer it.
Status FrameStep::AnalyzeAndFactorize() {
  const IncrementalSchur& schur = context_.system.schur();
  has_factor_ = false;
  const ReducedMatrix A(schur.S(), reduced_.damping().data(), reduced_.constant().data());
  if (analyzed_version_ != schur.S().version()) {
    const Status analyzed = solver_->Analyze(A);
    if (!analyzed.ok()) {
      // The rows that were taken are lost otherwise: after a failed analysis nothing of them is
      // factored.
      all_changed_ = true;  // when it is tried again
      return analyzed;
    }
    analyzed_version_ = schur.S().version();
  }
  ReducedSolver::Rows changed{FirstOf(changed_rows_, schur), &changed_rows_};
  // No list: perhaps all rows from 0 on.
  if (std::exchange(all_changed_, false)) {
    changed = {};
  }
  const Status factored =
      NameVariable(*solver_, solver_->Factorize(A, changed),
                   [&schur](std::size_t row) { return schur.frames()[row].id; });
  has_factor_ = factored.ok();
  factored_mu_ = reduced_.mu();
  return factored;
}

// A sum in the order of the rows, onto `start`, so that its bits do not depend on who adds.
double FrameStep::AddGain(double start) const {
  double sum = start;
  for (std::size_t k = 0; k < values_.size(); ++k) {
    sum += 0.5 * reduced_.b()[k] * values_[k];
  }
  return sum;
}

// In the variables' own units.
double FrameStep::Norm() const {
  double squared = 0.0;
  for (const double entry : values_) {
    squared += entry * entry;
  }
  return std::sqrt(squared);
}

// ReducedSolver::Solve asks for that: a row whose part of x was applied counts as changed.
void FrameStep::TakeOff(const std::vector<std::int32_t>& frames) {
  IncrementalSchur& schur = context_.system.schur();
  for (const std::int32_t frame : frames) {
    const double* applied = context_.system.step().Frame(frame);
    double* step = values_.data() + schur.FrameOffset(frame);
    for (int k = 0; k < schur.frames()[frame].size; ++k) {
      step[k] -= applied[k];
    }
    schur.changes().TouchB(frame);
  }
}

}  // namespace inceres::internal
