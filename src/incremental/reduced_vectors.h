#pragma once

#include <cstdint>
#include <vector>

#include "inceres/solver/incremental_options.h"
#include "incremental/incremental_schur.h"

namespace inceres::internal {

/// The vectors that go with S to its solver, packed by block rows as S is, and what each row could
/// gain by itself. Cost: that of the rows that have changed, and a pass over all when μ has.
class ReducedVectors {
 public:
  /// Takes over what has changed since the last call. True if the damping of all rows has: μ or its
  /// form is another.
  bool Refresh(DampingForm form, double mu, IncrementalSchur* schur);

  double mu() const { return mu_; }
  const std::vector<double>& weights() const { return weights_; }  ///< diag(C)
  /// μ diag(C), the thesis's form μ diag(S); of a row that is held 1, as ReducedMatrix has it, and
  /// its b is 0. Of an entry that is held at a bound so much that it stays, and its b is 0 too.
  const std::vector<double>& damping() const { return damping_; }
  const std::vector<double>& b() const { return b_; }
  const std::vector<char>& constant() const { return constant_; }  ///< per row: it is held
  /// Per row: twice what its scalars could gain one by one; 0 for a row that is held.
  const std::vector<double>& pulls() const { return pulls_; }
  /// The same of a row, for another right-hand side; `rhs` points to the row's entries.
  double Pull(const IncrementalSchur& schur, std::int32_t row, const double* rhs) const;
  std::int64_t Bytes() const;

 private:
  void Read(const IncrementalSchur& schur, std::int32_t row);
  void Damp(const IncrementalSchur& schur, std::int32_t row);

  DampingForm form_ = DampingForm::kHybrid;
  double mu_ = -1.0;
  std::vector<double> weights_;
  std::vector<double> diagonal_;  // of S
  std::vector<double> damping_;
  std::vector<double> b_;
  std::vector<double> pulls_;
  std::vector<char> constant_;
  std::vector<std::int32_t> changed_;
};

}  // namespace inceres::internal
