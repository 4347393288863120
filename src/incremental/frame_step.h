#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "incremental/incremental_system.h"
#include "incremental/reduced_vectors.h"
#include "incremental/update_context.h"
#include "linear/resuming.h"

namespace inceres::internal {

/// The step δ_c of all frames, (S + μ diag C) δ_c = b with the μ of the moment: what of it is not
/// taken is kept, and the next solve changes only what a change worth noticing reaches (iSAM2's
/// wildfire). Times and counts go to the Update's summary.
class FrameStep {
 public:
  explicit FrameStep(UpdateContext* context);

  /// Follows S and b, and factors anew. kSingular if there is no factor.
  Status Factorize();
  /// What the model promises for the whole step, all of it still undone, goes into the summary;
  /// `landmark_gain` is the landmarks' part. False: not before the step is known.
  bool SeesLeft(double landmark_gain);
  /// Solves anew.
  Status Solve();
  /// Takes over changes of S and b only; not timed.
  void Refresh() { Follow(context_.control.mu()); }
  /// What a change of a frame's step must be worth to be noticed.
  double Wildfire() const;
  /// ½ bᵀδ, added to `start`.
  double AddGain(double start) const;
  /// ‖δ_c‖ of the step that is still to take.
  double Norm() const;
  /// What was applied of these frames' steps is no longer part of the step still to take.
  void TakeOff(const std::vector<std::int32_t>& frames);

  /// Between Updates, with this damping: follows S and b and factors, for those who want the
  /// factor, not a step. Counted nowhere.
  Status FactorizeWith(double mu);
  /// Whether the last factorization has given a factor, of rows and blocks that S still has.
  bool HasFactor() const {
    return has_factor_ && analyzed_version_ == context_.system.schur().S().version();
  }
  /// Whether the last Factorize was with the damping of now.
  bool HasDampingOfNow() const { return context_.control.mu() == mu_of_update_; }
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
  void Follow(double mu) {
    all_changed_ |= reduced_.Refresh(context_.options.damping, mu, &context_.system.schur());
  }
  Status AnalyzeAndFactorize();

  UpdateContext& context_;
  std::unique_ptr<ReducedSolver> solver_;  // null: a user's factory made none
  HalfSolves* half_solves_ = nullptr;      // the same, if it can
  ReducedSolver::Work work_;
  ReducedVectors reduced_;
  bool has_factor_ = false;
  double factored_mu_ = 0.0;
  double mu_of_update_ = -1.0;          // of the last Factorize
  bool all_changed_ = false;            // since S was factored: μ or its form is another
  std::int64_t analyzed_version_ = -1;  // of S's pattern
  std::vector<double> values_;          // packed by block rows
  std::vector<std::int32_t> changed_rows_;
};

}  // namespace inceres::internal
