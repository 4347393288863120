#pragma once

#include <algorithm>
#include <vector>

#include "linear/envelope_cholesky.h"
#include "linear/envelope_order.h"
#include "linear/live_reduced_solver.h"

namespace inceres::internal {

/// The envelope Cholesky factor resumed at the first changed row, and with it the substitutions:
///
///     y = L⁻¹ b    resumed at the first row of L or b that changed
///     x = L⁻ᵀ y    backwards, until no row further up is reached by a change ("wildfire")
///
/// Row k of x has to be found anew if y_k changed or if a row i > k with L_ik ≠ 0 changed, in L or, beyond the threshold, in x_i.
/// Substituting backwards without a gap, one may stop as soon as no such row is coupled to the rows before. x_i is compared
/// with the value the rows before it were last computed with, so that many small changes add up and are noticed.
///
/// Without truncation: the same bits as EnvelopeCholesky from scratch. With it, every row of Lᵀx = y holds up to the changes of x
/// that were not passed on, each at most twice the threshold. Cost of a call: the rows from the first changed on and the rows
/// those reach. Source: Kaess et al., "iSAM2", IJRR 31(2), 2012, algorithm 7 (wildfire), in an envelope instead of a tree.
class ResumedSolver final : public LiveReducedSolver {
 public:
  const char* Name() const override { return "resumed Cholesky"; }
  Status Factorize(const SymmetricBlockRows& S, const double* damping, const char* held, const Change& change) override;
  Status Solve(const double* b, int first_changed_b, const Truncation& truncation, double* x) override;
  std::size_t Bytes() const override;

  /// Flops a Factorize would take with this change.
  double PredictFlops(const SymmetricBlockRows& S, const char* held, const Change& change) {
    return EnvelopeFlops(S, held, FirstRow(S, change), &workspace_);
  }
  /// Another solver has written x since: the next Solve finds all of it anew.
  void ForgetSolution() { num_passed_on_ = reached_before_ = 0; }

 private:
  int FirstRow(const SymmetricBlockRows& S, const Change& change) const {
    return std::min({change.first_row, cholesky_.num_valid_rows(), S.num_rows()});
  }
  void GrowTo(int size);
  void CopyRest(int first_scalar, int* filled);
  bool HasChanged(int row, const Truncation& truncation, const double* x) const;

  EnvelopeCholesky cholesky_;
  Status factored_;
  int num_current_y_ = 0;   // leading rows of y that belong to the factor and the last b
  int reached_before_ = 0;  // first row coupled, at the last Solve, to a row of L that has changed since
  int num_passed_on_ = 0;   // leading rows of L that have not changed since the last Solve
  AlignedVector<double> y_;
  AlignedVector<double> rest_;  // workspace: y less what later rows contribute
  std::vector<int> workspace_;
  std::vector<double> passed_on_;  // the x that the rows before it were computed with
};

}  // namespace inceres::internal
