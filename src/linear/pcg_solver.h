#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "inceres/linear/reduced_solver.h"
#include "linear/block_rows.h"
#include "linear/conjugate_gradients.h"

namespace inceres::internal {

struct PcgOptions {
  /// η: ends when ‖x − A⁻¹b‖_A ≤ η ‖x‖_A by estimate, in the norm of the energy: then the decrease
  /// of the cost that a step promises is right to a share η². In (0, 1).
  double relative_tolerance = 1e-6;
  /// ≥ 1. Where it ends first, Work::converged is false.
  int max_iterations = 5000;
};

/// Conjugate gradients on an A that grows, preconditioned by its diagonal blocks, whose state
/// outlives the call: blocks are inverted again only where they changed, and the iteration starts
/// from what the last solution left unapplied (unless that does worse than zero).
///
/// When to end: the squared error is estimated by the gains of the last iterations, more of them
/// the longer it takes. The norm of the residual would do badly: scaled by a prior of 1e14, or by a
/// gauge that damping alone holds, it says nothing of the error.
///
/// kSingular if a direction of curvature ≤ 0 turns up. Threads: the calling one. Source: Liu, Chen,
/// Zhao & Zhang, "ICE-BA", CVPR 2018 (I-PCG); Hestenes & Stiefel 1952, theorem 6:1, and Strakos &
/// Tichy, "On error estimation in the conjugate gradient method", ETNA 13, 2002 (the estimate).
class PcgSolver final : public ReducedSolver, private ConjugateGradients::System {
 public:
  explicit PcgSolver(const PcgOptions& options) : options_(options) {}

  const char* Name() const override { return "incremental PCG"; }
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override;
  /// Truncation is not for an iteration: all of x is written.
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override;
  std::size_t Bytes() const override;

 private:
  // A diagonal block M_i of A and −M_i⁻¹, kept while they do not change.
  struct Block {
    int size = 0;  // 0: held, or a removed row
    AlignedVector<double> M;
    AlignedVector<double> minus_inverse;
  };

  void FindOffsets(int first_row);
  Status InvertChanged(const ReducedMatrix& A, const Rows& changed);
  bool Invert(const ReducedMatrix& A, int row);
  int num_rows() const { return static_cast<int>(blocks_.size()); }
  bool IsFree(int row) const { return blocks_[row].size > 0; }
  void SubtractProduct(const double* v, double* y) const override;
  bool Precondition(const double* r, double* z) override;
  bool IsGoodEnough(const ConjugateGradients& iteration) const override;
  void PadFree(const double* packed, double* padded) const;
  void Unpad(const double* padded, double* packed) const;

  PcgOptions options_;
  std::vector<Block> blocks_;
  std::vector<int> stale_;  // block rows to be inverted
  // First scalar of each block row, in packed vectors and in padded ones, where each row begins on
  // a quad and the padding is zero; one more: the totals.
  std::vector<int> packed_{0};
  std::vector<int> padded_{0};
  AlignedVector<double> L_;  // workspace
  AlignedVector<double> inverse_pivots_;
  ConjugateGradients iteration_;
  Status factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
  const SymmetricBlockRows* S_ = nullptr;
};

}  // namespace inceres::internal
