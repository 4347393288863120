#pragma once

#include <memory>
#include <vector>

#include "base/executor.h"
#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// Conjugate gradients on A = S + diag, preconditioned by the Cholesky factor M of an earlier A: from one iteration of a solver
/// to the next S changes little, so a few products with it replace a factorization. The factor is renewed when an iteration has
/// taken long, and when it does not end: then it is exact. Diagonal blocks for a preconditioner, as in ICE-BA, do not do where
/// speeds, biases and poses are tied by weights of 1e8: the 744 unknowns of vio:cubic take 3,000 iterations.
///
/// Ends when rᵀM⁻¹r ≤ η² bᵀM⁻¹b: for M near A that is the squared error in the norm of the energy, so the decrease of the cost
/// that a step promises is right to a share η².
///
/// kSingular where the factor is asked for and A is not positive definite. Cost of an iteration: one product with S, one
/// substitution. Threads: those of the factorization; the same bits for any number. Source: Golub & Van Loan, section 11.5;
/// Nocedal & Wright, section 7.1 (inexact Newton steps).
class LaggedPcg final : public ReducedSolver {
 public:
  static constexpr double kTolerance = 1e-4;  // η
  static constexpr int kRenewAfter = 8;       // iterations: the next Factorize renews the factor
  static constexpr int kMaxIterations = 24;   // it is renewed at once

  explicit LaggedPcg(const Executor& executor) : executor_(executor) {}
  /// Analyzed: `factor` has analyzed this pattern.
  LaggedPcg(const Executor& executor, const BlockPattern& pattern, std::unique_ptr<ReducedSolver> factor);

  const char* Name() const override { return "PCG with an earlier factor"; }
  Status Analyze(const BlockPattern& pattern) override;
  Status Factorize(const double* values, const double* diagonal) override;
  Status Solve(const double* b, double* x) override;

  /// Of the last Solve.
  int num_iterations() const { return num_iterations_; }
  /// Since Analyze.
  int num_factorizations() const { return num_factorizations_; }

 private:
  void Prepare(const BlockPattern& pattern);
  Status Renew();
  /// False if it did not end, or met a direction of curvature ≤ 0.
  bool Iterate(const double* b, double* x);
  /// y = A v.
  void Multiply(const double* v, double* y) const;

  const Executor& executor_;
  const BlockPattern* pattern_ = nullptr;
  std::unique_ptr<ReducedSolver> factor_;
  std::vector<double> values_, diagonal_;  // of A
  bool factored_ = false;                  // some A, perhaps an earlier one
  int num_iterations_ = 0;
  int num_factorizations_ = 0;
  std::vector<double> r_, z_, p_, q_;  // residual, preconditioned, direction, A times it
};

}  // namespace inceres::internal
