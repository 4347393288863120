#include "incremental/frame_step.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "linear/select_solver.h"

namespace inceres::internal {
namespace {

int FirstOf(const std::vector<std::int32_t>& ascending_rows, const IncrementalSchur& schur) {
  return ascending_rows.empty() ? schur.S().num_rows() : ascending_rows.front();
}

int CountOf(int rows, const IncrementalSchur& schur) {
  return rows == ReducedSolver::Work::kAll ? schur.structure().num_frames() : rows;
}

}  // namespace

FrameStep::FrameStep(const IncrementalOptions& options, const Executor& executor)
    : solver_(MakeResumingSolver(options.reduced_solver, options.reduced_solver_factory,
                                 PcgOptions(), executor)),
      half_solves_(dynamic_cast<HalfSolves*>(solver_.get())) {
}

Status FrameStep::Factorize(DampingForm form, double mu, IncrementalSchur* schur,
                            UpdateTrace* trace) {
  if (solver_ == nullptr) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "IncrementalOptions::reduced_solver_factory returned null");
  }
  Refresh(form, mu, schur);
  values_.resize(schur->size(), 0.0);
  schur->changes().TakeUnfactored(&changed_rows_);
  work_ = ReducedSolver::Work();
  trace->row().linear_solver_iterations = 1;
  if (schur->size() == 0) {
    all_changed_ = true;  // the solver has not seen them go
    return Status::Ok();
  }
  const Status factored = AnalyzeAndFactorize(*schur);
  work_ = solver_->work();
  trace->summary().num_factored_rows += CountOf(work_.factored_rows, *schur);
  trace->summary().num_reorderings += work_.reorderings;
  return factored;
}

bool FrameStep::FindGain(IncrementalSchur* schur, double* gain) {
  if (half_solves_ == nullptr || schur->size() == 0) {
    return false;
  }
  schur->changes().TakeUnsolved(&changed_rows_);
  const ReducedSolver::Rows changed_b{FirstOf(changed_rows_, *schur), &changed_rows_};
  return half_solves_->SolveForGain(reduced_.b().data(), changed_b, gain).ok();
}

Status FrameStep::Solve(double wildfire, IncrementalSchur* schur, UpdateTrace* trace) {
  if (schur->size() == 0) {
    return Status::Ok();
  }
  UpdateSummary& summary = trace->summary();
  schur->changes().TakeUnsolved(&changed_rows_);
  const ReducedSolver::Rows changed_b{FirstOf(changed_rows_, *schur), &changed_rows_};
  const Status solved = solver_->Solve(reduced_.b().data(), changed_b,
                                       {reduced_.weights().data(), wildfire}, values_.data());
  work_ = solver_->work();
  summary.num_solved_rows += CountOf(work_.solved_rows, *schur);
  summary.num_pcg_iterations += work_.iterations;
  trace->row().linear_solver_iterations = std::max(1, work_.iterations);
  return solved;
}

Status FrameStep::FactorizeOnly(DampingForm form, double mu, IncrementalSchur* schur) {
  if (solver_ == nullptr || schur->size() == 0) {
    return Status::Ok();
  }
  Refresh(form, mu, schur);
  values_.resize(schur->size(), 0.0);
  schur->changes().TakeUnfactored(&changed_rows_);
  return AnalyzeAndFactorize(*schur);
}

Status FrameStep::AnalyzeAndFactorize(const IncrementalSchur& schur) {
  has_factor_ = false;
  const ReducedMatrix A(schur.S(), reduced_.damping().data(), reduced_.constant().data());
  if (analyzed_version_ != schur.S().version()) {
    const Status analyzed = solver_->Analyze(A);
    if (!analyzed.ok()) {
      all_changed_ = true;  // when it is tried again
      return analyzed;
    }
    analyzed_version_ = schur.S().version();
  }
  ReducedSolver::Rows changed{FirstOf(changed_rows_, schur), &changed_rows_};
  if (std::exchange(all_changed_, false)) {
    changed = {};
  }
  const Status factored = solver_->Factorize(A, changed);
  has_factor_ = factored.ok();
  factored_mu_ = reduced_.mu();
  return factored;
}

double FrameStep::AddGain(double start) const {
  double sum = start;
  for (std::size_t k = 0; k < values_.size(); ++k) {
    sum += 0.5 * reduced_.b()[k] * values_[k];
  }
  return sum;
}

double FrameStep::Norm() const {
  double squared = 0.0;
  for (const double entry : values_) {
    squared += entry * entry;
  }
  return std::sqrt(squared);
}

void FrameStep::TakeOff(const std::vector<std::int32_t>& frames, IncrementalSystem* system) {
  IncrementalSchur& schur = system->schur();
  for (const std::int32_t frame : frames) {
    const double* applied = system->step().Frame(frame);
    double* step = values_.data() + schur.FrameOffset(frame);
    for (int k = 0; k < schur.frames()[frame].size; ++k) {
      step[k] -= applied[k];
    }
    schur.changes().TouchB(frame);
  }
}

}  // namespace inceres::internal
