#pragma once

#include <cstddef>
#include <vector>

#include "inceres/problem/ambient_family.h"

namespace inceres::internal {

/// U (x_j − A x_i − t) of two vectors of `size` values, 2 or 3, in slots i and j: linear.
class LinearDifferenceFamily final : public AmbientFamily<LinearDifferenceFamily> {
 public:
  struct Measurement {
    double U[9] = {};  ///< row-major, size × size, as A
    double A[9] = {};
    double t[3] = {};
  };

  explicit LinearDifferenceFamily(int size)
      : AmbientFamily(size, {{size, size}, {size, size}}), size_(size) {}

  void Resize(int num_factors) { measurements_.resize(static_cast<std::size_t>(num_factors)); }
  Measurement& at(int i) { return measurements_[static_cast<std::size_t>(i)]; }

  int size() const override { return static_cast<int>(measurements_.size()); }
  const char* Name() const override { return "linear difference"; }
  bool HasConstantJacobian() const override { return true; }

  bool EvaluateOne(int i, const double* const* x, double* residuals, double** jacobians) const {
    const Measurement& m = measurements_[static_cast<std::size_t>(i)];
    double e[3];
    for (int r = 0; r < size_; ++r) {
      e[r] = x[1][r] - m.t[r];
      for (int c = 0; c < size_; ++c) {
        e[r] -= m.A[size_ * r + c] * x[0][c];
      }
    }
    for (int r = 0; r < size_; ++r) {
      residuals[r] = 0.0;
      for (int k = 0; k < size_; ++k) {
        residuals[r] += m.U[size_ * r + k] * e[k];
      }
    }
    for (int s = 0; jacobians != nullptr && s < 2; ++s) {
      if (jacobians[s] != nullptr) {
        Differentiate(m, s, jacobians[s]);
      }
    }
    return true;
  }

 private:
  void Differentiate(const Measurement& m, int slot, double* J) const {
    for (int r = 0; r < size_; ++r) {
      for (int c = 0; c < size_; ++c) {
        double sum = slot == 1 ? m.U[size_ * r + c] : 0.0;
        for (int k = 0; slot == 0 && k < size_; ++k) {
          sum -= m.U[size_ * r + k] * m.A[size_ * k + c];
        }
        J[size_ * r + c] = sum;
      }
    }
  }

  int size_;
  std::vector<Measurement> measurements_;
};

}  // namespace inceres::internal
