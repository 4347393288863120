#pragma once

#include <vector>

#include "linear/block_jacobi.h"
#include "linear/incremental_reduced_solver.h"

namespace inceres::internal {

struct PcgOptions {
  /// η: ends when ‖x − A⁻¹b‖_A ≤ η ‖x‖_A by estimate, in the norm of the energy: then the decrease of the cost that a step
  /// promises is right to a share η². In (0, 1).
  double relative_tolerance = 1e-6;
  /// ≥ 1. Where it ends first, Work::converged is false.
  int max_iterations = 5000;
};

/// Conjugate gradients on A = S + diag(damping), preconditioned by A's diagonal blocks, whose state outlives the call: blocks are
/// inverted again only where they changed, and the iteration starts from what the last solution left unapplied (unless that does
/// worse than zero).
///
/// When to end: each iteration raises the promised decrease bᵀx − ½xᵀAx by ½ α rᵀz, and the rest to come is half the squared
/// error in the energy norm. It is estimated by the sum over the last iterations, more of them the longer it takes. The norm of
/// the residual would do badly: scaled by a prior of 1e14, or by a gauge that damping alone holds, it says nothing of the error.
///
/// kSingular if a direction of curvature ≤ 0 turns up. Cost of an iteration: one product with S and one with the blocks. Threads:
/// the calling one. Source: Liu, Chen, Zhao & Zhang, "ICE-BA", CVPR 2018 (I-PCG); Hestenes & Stiefel 1952, theorem 6:1, and
/// Strakos & Tichy, "On error estimation in the conjugate gradient method", ETNA 13, 2002 (the estimate).
class PcgSolver final : public IncrementalReducedSolver {
 public:
  explicit PcgSolver(const PcgOptions& options) : options_(options) {}

  const char* Name() const override { return "incremental PCG"; }
  Status Factorize(const SymmetricBlockRows& S, const double* damping, const char* held, const Change& change) override;
  /// Truncation is not for an iteration: all of x is written.
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation, double* x) override;
  std::size_t Bytes() const override;

 private:
  void PadFree(const double* packed, AlignedVector<double>* padded) const;
  void Unpad(double* packed) const;
  void SubtractProduct(const double* v, double* y) const;
  void Start();
  Status Iterate();
  bool HasConverged() const;

  PcgOptions options_;
  BlockJacobi preconditioner_;
  Status factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
  const SymmetricBlockRows* S_ = nullptr;

  AlignedVector<double> b_;
  AlignedVector<double> x_;
  AlignedVector<double> r_;  // b − A x
  AlignedVector<double> z_;  // M⁻¹ r
  AlignedVector<double> p_;  // direction
  AlignedVector<double> minus_product_;
  double decrease_ = 0.0;      // bᵀx − ½ xᵀAx
  std::vector<double> gains_;  // of decrease_, by iteration
};

}  // namespace inceres::internal
