#include "incremental/frame_step.h"

#include <algorithm>
#include <utility>

#include "linear/select_incremental_solver.h"

namespace inceres::internal {
namespace {

int FirstOf(const std::vector<std::int32_t>& ascending_rows, const IncrementalSchur& schur) {
  return ascending_rows.empty() ? schur.S().num_rows() : ascending_rows.front();
}

}  // namespace

FrameStep::FrameStep(const IncrementalOptions& options, const Executor& executor)
    : solver_(MakeIncrementalReducedSolver(options.reduced_solver, options.reduced_solver_factory, PcgOptions(), executor)) {
}

Status FrameStep::Solve(DampingForm form, double mu, double wildfire, IncrementalSchur* schur, UpdateTrace* trace) {
  Refresh(form, mu, schur);
  values_.resize(schur->size(), 0.0);
  schur->TakeUnfactoredRows(&changed_rows_);
  IncrementalReducedSolver::Change change(FirstOf(changed_rows_, *schur), &changed_rows_, true);
  if (std::exchange(damped_anew_, false)) {
    change = IncrementalReducedSolver::Change();  // of everything
  }
  UpdateSummary& summary = trace->summary();
  const Status factored = solver_->Factorize(schur->S(), reduced_.damping().data(), reduced_.held().data(), change);
  summary.num_factored_rows += work().factored_rows;
  summary.num_reorderings += work().reorderings;
  if (!factored.ok()) {
    return factored;
  }
  IncrementalReducedSolver::Truncation truncation;
  truncation.weights = reduced_.weights().data();
  truncation.threshold = wildfire;
  schur->TakeUnsolvedRows(&changed_rows_);
  const IncrementalReducedSolver::Rows changed_b{FirstOf(changed_rows_, *schur), &changed_rows_};
  Status solved = solver_->Solve(reduced_.b().data(), changed_b, truncation, values_.data());
  summary.num_solved_rows += work().solved_rows;
  summary.num_pcg_iterations += work().iterations;
  trace->row().num_linear_solver_iterations = std::max(1, work().iterations);
  return solved;
}

double FrameStep::AddGain(double start) const {
  double sum = start;
  for (std::size_t k = 0; k < values_.size(); ++k) {
    sum += 0.5 * reduced_.b()[k] * values_[k];
  }
  return sum;
}

void FrameStep::TakeOff(const std::vector<std::int32_t>& frames, IncrementalSystem* system) {
  IncrementalSchur& schur = system->schur();
  for (const std::int32_t frame : frames) {
    const double* applied = system->step().Frame(frame);
    double* step = values_.data() + schur.FrameOffset(frame);
    for (int k = 0; k < schur.frames()[frame].size; ++k) {
      step[k] -= applied[k];
    }
    schur.TouchB(frame);
  }
}

}  // namespace inceres::internal
