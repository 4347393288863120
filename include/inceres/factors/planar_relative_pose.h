#pragma once

#include <vector>

#include "inceres/export.h"
#include "inceres/problem/ambient_family.h"

namespace inceres {

/// A measured relative pose of two planar poses a, b, each [x y θ], meters and radians, without a
/// manifold: angles may be any number of turns apart. With analytic Jacobians.
///
///     residual = U [ R(θ_a)ᵀ (p_b − p_a) − p_m ; wrap(θ_b − θ_a − θ_m) ]        (3 rows, whitened; wrap to [−π, π])
///
/// Threads: as FactorFamily; Add is for one writer.
class INCERES_EXPORT PlanarRelativePoseFamily final
    : public AmbientFamily<PlanarRelativePoseFamily> {
 public:
  struct Measurement {
    double motion[3] = {0.0, 0.0, 0.0};  ///< p_m, θ_m: b seen from a
    double sqrt_information[9] = {
        1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0};  ///< U, row-major, upper triangular, see SqrtInformation
  };

  PlanarRelativePoseFamily() : AmbientFamily(3, {{3, 3}, {3, 3}}) {}

  void Add(const Measurement& measurement) { measurements_.push_back(measurement); }
  /// Overwrites the measurement at `index`, or appends it if index == size().
  void Place(int index, const Measurement& measurement) {
    PlaceIn(&measurements_, index, measurement);
  }

  int size() const override { return static_cast<int>(measurements_.size()); }
  const char* Name() const override { return "planar relative pose"; }

  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const;

 private:
  std::vector<Measurement> measurements_;
};

}  // namespace inceres
