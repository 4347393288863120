#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "base/aligned_vector.h"

namespace inceres::internal {

/// Conjugate gradients on A x = b with a preconditioner M, whatever these are. Vectors are in whole
/// quads, padded with zeros.
///
/// Each iteration raises bᵀx − ½xᵀAx by ½ α rᵀz, and what is still to come is half the squared
/// error in the norm of the energy. Cost of one: a product with A and one with M⁻¹. Threads: those
/// of the products. Source: Hestenes & Stiefel 1952; Golub & Van Loan, section 11.5.
class ConjugateGradients {
 public:
  class System {
   public:
    virtual ~System() = default;
    /// y −= A v.
    virtual void SubtractProduct(const double* v, double* y) const = 0;
    /// z = M⁻¹ r. False: M cannot.
    virtual bool Precondition(const double* r, double* z) = 0;
    /// Whether to end, after an iteration.
    virtual bool IsGoodEnough(const ConjugateGradients& iteration) const = 0;
  };
  /// kBreakdown: rᵀM⁻¹r or pᵀAp is not a number.
  enum class End { kConverged, kTooLong, kNotPositiveDefinite, kNoPreconditioner, kBreakdown };

  /// Room for vectors of `size` entries. b and x are then to be written, or left as they were.
  void Resize(std::size_t size);
  double* b() { return b_.data(); }
  double* x() { return x_.data(); }

  /// Begins with x = 0.
  void StartFromZero();
  /// Begins with x as it is if that promises a decrease, else with 0.
  void StartFromX(const System& system);
  /// Improves x until the system says it is good enough, or for so many iterations. Where it does
  /// not end well x is the best so far. With a reset_period r is computed anew, b − A x, in every
  /// iteration that is a multiple of it; 0: never.
  End Iterate(System* system, int max_iterations, int reset_period = 0);

  /// bᵀx − ½ xᵀAx, and what each iteration has added to it.
  double decrease() const { return decrease_; }
  const std::vector<double>& gains() const { return gains_; }
  /// rᵀM⁻¹r: now, and at the start.
  double rz() const { return rz_; }
  double first_rz() const { return first_rz_; }
  /// pᵀAp of the last direction.
  double curvature() const { return curvature_; }
  std::size_t Bytes() const;

 private:
  std::optional<End> Step(const System& system, int reset_period);

  AlignedVector<double> b_;
  AlignedVector<double> x_;
  AlignedVector<double> r_;  // b − A x
  AlignedVector<double> z_;  // M⁻¹ r
  AlignedVector<double> p_;  // direction
  AlignedVector<double> minus_product_;
  double decrease_ = 0.0;
  std::vector<double> gains_;
  double rz_ = 0.0;
  double first_rz_ = 0.0;
  double curvature_ = 0.0;
};

}  // namespace inceres::internal
