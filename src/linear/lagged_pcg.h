#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <utility>

#include "inceres/linear/reduced_solver.h"
#include "linear/conjugate_gradients.h"

namespace inceres::internal {

/// Conjugate gradients on A of a batch solve, preconditioned by the Cholesky factor M of an earlier
/// A: from one iteration of a solver to the next S changes little, so a few products with it
/// replace a factorization. The factor is renewed when an iteration has taken long, and when it
/// does not end: then it is exact. Diagonal blocks for a preconditioner, as in ICE-BA, do not do
/// where speeds, biases and poses are tied by weights of 1e8: the 744 unknowns of vio:cubic take
/// 3,000 iterations.
///
/// Ends when rᵀM⁻¹r ≤ η² bᵀM⁻¹b: for M near A that is the squared error in the norm of the energy,
/// so the decrease of the cost that a step promises is right to a share η².
///
/// kSingular where the factor is asked for and A is not positive definite. Threads: those of the
/// factorization; the same bits for any number. Source: Nocedal & Wright, section 7.1 (inexact
/// Newton steps).
class LaggedPcg final : public ReducedSolver, private ConjugateGradients::System {
 public:
  static constexpr double kTolerance = 1e-4;  // η
  static constexpr int kRenewAfter = 8;       // iterations: the next Factorize renews the factor
  static constexpr int kMaxIterations = 24;   // it is renewed at once

  /// `factor` may have analyzed the pattern already.
  explicit LaggedPcg(std::unique_ptr<ReducedSolver> factor) : factor_(std::move(factor)) {}

  const char* Name() const override { return "PCG with an earlier factor"; }
  Status Analyze(const ReducedMatrix& A) override;
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override;
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override;
  std::size_t Bytes() const override { return factor_->Bytes() + iteration_.Bytes(); }

  /// That it is preconditioned by.
  const ReducedSolver& factor() const { return *factor_; }

 private:
  Status Renew();
  void SubtractProduct(const double* v, double* y) const override;
  bool Precondition(const double* r, double* z) override {
    return factor_->Solve(r, {}, {}, z).ok();
  }
  bool IsGoodEnough(const ConjugateGradients& iteration) const override {
    return iteration.rz() <= kTolerance * kTolerance * iteration.first_rz();
  }

  std::unique_ptr<ReducedSolver> factor_;
  ConjugateGradients iteration_;
  std::optional<ReducedMatrix> A_;
  bool factored_ = false;  // some A, perhaps an earlier one
};

}  // namespace inceres::internal
