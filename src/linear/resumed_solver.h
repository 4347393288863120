#pragma once

#include <algorithm>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "linear/envelope_cholesky.h"
#include "linear/envelope_order.h"
#include "linear/resuming.h"
#include "linear/row_order.h"

namespace inceres::internal {

/// The envelope Cholesky factor resumed at the first changed row, and with it the substitutions:
///
///     y = L⁻¹ b    resumed at the first row of L or b that changed
///     x = L⁻ᵀ y    backwards, until no row further up is reached by a change ("wildfire")
///
/// Row k of x has to be found anew if y_k changed or if a row i > k with L_ik ≠ 0 changed, in L or,
/// beyond the threshold, in x_i. Substituting backwards without a gap, one may stop as soon as no
/// such row is coupled to the rows before. x_i is compared with the value the rows before it were
/// last computed with, so that many small changes add up and are noticed.
///
/// New rows of S come last in the factor. A loop makes that order age: its long rows fill the
/// envelope, and old rows that change again have everything behind them refactored, each time. But
/// what is to be refactored may as well come in another order, so when a Factorize is dear another
/// order of those rows is looked for, with the changed ones last, and taken if it makes this
/// Factorize and one like it cheaper by a good deal. The reordering itself costs no factorization,
/// and the next change there finds the end of the factor; so it does not repeat itself.
///
/// Rows of a lower group (SymmetricBlockRows::group_of) go before those of a higher one: a new one
/// then has its place before these, and the factor is resumed there.
///
/// Without truncation: the same bits as EnvelopeCholesky from scratch in order(). With it, every
/// row of Lᵀx = y holds up to the changes of x that were not passed on, each at most twice the
/// threshold. Cost of a call: the rows from the first changed on and the rows those reach. Source:
/// Kaess et al., "iSAM2", IJRR 31(2), 2012, algorithm 7 (wildfire) and section 4.3 (reordering what
/// is eliminated anew), in an envelope instead of a tree.
class ResumedSolver final : public ReducedSolver, public HalfSolves {
 public:
  const char* Name() const override { return "resumed Cholesky"; }
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override {
    PlanFor(A, changed);
    return FactorizeAsPlanned(A);
  }
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override;
  Status SolveForGain(const double* b, const Rows& changed_b, double* gain) override;
  std::size_t Bytes() const override;

  // Factorize in two halves, for who wants to know what it costs before. The second may be left
  // out: the next first half counts its change too.

  struct Plan {
    double flops = 0.0;  // of the second half
    // What that takes, and taking up the same change once more after it, as so many flops: an
    // entry takes some beside its own.
    double cost = 0.0;
    double again = 0.0;
  };
  Plan PlanFor(const ReducedMatrix& A, const Rows& changed);
  Status FactorizeAsPlanned(const ReducedMatrix& A);

  /// Another solver takes this matrix: what PlanFor would say is not asked for.
  void MissFactorize(const Rows& changed) {
    num_exact_ = std::min(num_exact_, FirstPlace(changed));
  }
  /// Another solver takes this b and writes x.
  void MissSolve(const Rows& changed_b);

  const RowOrder& order() const { return order_; }
  /// The factor in that order.
  const EnvelopeCholesky& cholesky() const { return cholesky_; }

 private:
  int FirstPlace(const Rows& rows) const;
  void KeepGroups(const SymmetricBlockRows& S);
  Plan Predict(const ReducedMatrix& A, int first_changed);
  bool OrderMayHaveAged(const SymmetricBlockRows& S) const;
  void Reorder(const ReducedMatrix& A, const Rows& changed);
  void ForgetSolution() { num_passed_on_ = reached_before_ = 0; }
  int SubstituteForward(const double* b, const Rows& changed_b);
  void GrowTo(int size);
  void CopyRest(int first_scalar, int* filled);
  void HandOut(int first_place, double* x);

  RowOrder order_;
  EnvelopeCholesky cholesky_;
  int num_exact_ = 0;  // leading rows of L that S, as last seen, leaves as they are
  Plan plan_;
  int reorderings_ = 0;  // since the last factorization
  Status factored_;
  int num_current_squares_ = 0;  // leading rows of y whose squares are summed
  int num_current_y_ = 0;        // leading rows of y that belong to the factor and the last b
  // first row coupled, at the last Solve, to a row of L that has changed since, or whose y has
  int reached_before_ = 0;
  int num_passed_on_ = 0;  // leading rows of L that have not changed since the last Solve
  RowPacking packing_;     // of the caller's vectors
  std::vector<int> solved_;

  // By places.
  std::vector<double> damping_;
  std::vector<double> b_;
  AlignedVector<double> y_;
  AlignedVector<double> rest_;  // workspace: y less what later rows contribute
  std::vector<double> x_;
  std::vector<double> passed_on_;  // the x that the rows before it were computed with
  std::vector<double> squares_;    // of the rows of y before a place

  EnvelopeOrdering ordering_;
  std::vector<int> last_;
  std::vector<int> tail_;
  std::vector<int> workspace_;
};

}  // namespace inceres::internal
