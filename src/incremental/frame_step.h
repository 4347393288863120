#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "inceres/solver/incremental_options.h"
#include "incremental/incremental_system.h"
#include "incremental/reduced_vectors.h"
#include "incremental/update_trace.h"
#include "linear/half_solves.h"

namespace inceres::internal {

/// The step δ_c of all frames, (S + μ diag C) δ_c = b: what of it is not taken is kept, and the
/// next solve changes only what a change worth noticing reaches (iSAM2's wildfire).
class FrameStep {
 public:
  FrameStep(const IncrementalOptions& options, const Executor& executor);

  /// Follows S and b, and factors anew. kSingular if there is no factor.
  Status Factorize(DampingForm form, double mu, IncrementalSchur* schur, UpdateTrace* trace);
  /// ½ bᵀδ before δ is known, where the solver can say so: true, and `gain` is set.
  bool FindGain(IncrementalSchur* schur, double* gain);
  /// Solves anew. `wildfire`: what a change of a row must be worth.
  Status Solve(double wildfire, IncrementalSchur* schur, UpdateTrace* trace);
  /// Takes over changes of S and b only.
  void Refresh(DampingForm form, double mu, IncrementalSchur* schur) {
    all_changed_ |= reduced_.Refresh(form, mu, schur);
  }
  /// ½ bᵀδ, added to `start`.
  double AddGain(double start) const;
  /// ‖δ_c‖ of the step that is still to take.
  double Norm() const;
  /// What was applied of these frames' steps is no longer part of the step still to take.
  void TakeOff(const std::vector<std::int32_t>& frames, IncrementalSystem* system);

  /// Follows S and b and factors, where Solve would: for those who want the factor, not a step.
  Status FactorizeOnly(DampingForm form, double mu, IncrementalSchur* schur);
  /// Whether the last factorization has given a factor, of rows and blocks that S still has.
  bool HasFactorOf(const IncrementalSchur& schur) const {
    return has_factor_ && analyzed_version_ == schur.S().version();
  }
  /// That the last factorization had.
  double factored_mu() const { return factored_mu_; }
  ReducedSolver* solver() const { return solver_.get(); }

  const ReducedVectors& reduced() const { return reduced_; }
  const std::vector<double>& values() const { return values_; }
  const ReducedSolver::Work& work() const { return work_; }
  std::int64_t Bytes() const {
    const std::size_t of_solver = solver_ != nullptr ? solver_->Bytes() : 0;
    return static_cast<std::int64_t>(of_solver + sizeof(double) * values_.capacity()) +
           reduced_.Bytes();
  }

 private:
  Status AnalyzeAndFactorize(const IncrementalSchur& schur);

  std::unique_ptr<ReducedSolver> solver_;  // null: a user's factory made none
  HalfSolves* half_solves_ = nullptr;      // the same, if it can
  ReducedSolver::Work work_;
  ReducedVectors reduced_;
  bool has_factor_ = false;
  double factored_mu_ = 0.0;
  bool all_changed_ = false;            // since S was factored: μ or its form is another
  std::int64_t analyzed_version_ = -1;  // of S's pattern
  std::vector<double> values_;          // packed by block rows
  std::vector<std::int32_t> changed_rows_;
};

}  // namespace inceres::internal
