#pragma once

#include <optional>
#include <vector>

#include "distributed/communicator.h"

namespace inceres::internal {

/// Conjugate gradients on A x = b whose vectors lie in parts on the ranks, with one reduction an
/// iteration: rᵀz, zᵀAz and zᵀAp are summed together, and with β the curvature of the next
/// direction is zᵀAz + 2 β zᵀAp + β² pᵀAp. The iterates are those of ConjugateGradients but for
/// rounding, and so is the rule to stop by: Ceres's, with the residual computed anew every ten
/// iterations. Source: Chronopoulos & Gear, "s-step iterative methods for symmetric linear
/// systems", 1989, without the orthogonality that their form of the curvature relies on.
///
/// All ranks decide by the same reduced numbers. Cost of an iteration: a product, a
/// preconditioning, a reduction of three numbers.
class MergedGradients {
 public:
  class System {
   public:
    virtual ~System() = default;
    /// y = A v, of the entries owned here.
    virtual void Multiply(const double* v, double* y) = 0;
    /// z = M⁻¹ r.
    virtual void Precondition(const double* r, double* z) = 0;
  };
  enum class End { kConverged, kTooLong, kNotPositiveDefinite, kBreakdown };
  struct Limits {
    double eta = 0.1;
    int min_iterations = 0;
    int max_iterations = 500;
  };

  explicit MergedGradients(const Communicator& ranks) : ranks_(ranks) {}

  /// From x = 0. b and x have as many entries as are owned here.
  End Solve(const Limits& limits, const std::vector<double>& b, System* system,
            std::vector<double>* x);

  /// Of the last Solve, as IterativeModel counts them.
  int num_iterations() const { return num_iterations_; }

 private:
  bool ReduceDots(const std::vector<double>& r);
  std::optional<End> Turn(System* system);
  void ComputeResidual(const std::vector<double>& b, const std::vector<double>& x, System* system);

  const Communicator& ranks_;
  std::vector<double> r_;
  std::vector<double> z_;
  std::vector<double> p_;
  std::vector<double> w_;  // A z
  std::vector<double> s_;  // A p
  double rz_ = 0.0;
  double zaz_ = 0.0;
  double zap_ = 0.0;
  double curvature_ = 0.0;  // pᵀA p
  int num_iterations_ = 0;
};

}  // namespace inceres::internal
