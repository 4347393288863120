#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace inceres::internal {

/// How much of the cost rounding may be (docs/algorithms.md, "Stopping rule"):
///
///     F_ε = ½ (n ε)² Σ_v ‖x_v‖_∞² tr H_vv,
///
/// for a residual that comes of n operations on numbers as large as J_v x_v is exact to
/// n ε ‖x_v‖ ‖J_v‖.
class CostRounding {
 public:
  /// A variable's values, and the diagonal of its block of H: diagonal(k).
  template <typename Diagonal>
  void Add(const double* values, int ambient_size, int tangent_size, const Diagonal& diagonal) {
    double trace = 0.0;
    for (int k = 0; k < tangent_size; ++k) {
      trace += diagonal(k);
    }
    double largest = 0.0;
    for (int k = 0; k < ambient_size; ++k) {
      largest = std::max(largest, std::fabs(values[k]));
    }
    sum_ += trace * largest * largest;
  }
  double Get() const {
    constexpr double kRounding = kOperations * std::numeric_limits<double>::epsilon();
    return 0.5 * kRounding * kRounding * sum_;
  }

 private:
  // On numbers of full size, that a residual is taken to come of.
  static constexpr double kOperations = 16.0;

  double sum_ = 0.0;
};

}  // namespace inceres::internal
