#pragma once

#include <ceres/version.h>

#if CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR < 2
#include <ceres/local_parameterization.h>
#else
#include <ceres/manifold.h>
#endif

namespace sliding_window {

// VINS is written with LocalParameterizations, which Ceres has up to 2.1. From 2.2 on this stands
// in, as in programs that moved on.
#if CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR < 2

using ceres::LocalParameterization;

#else

class LocalParameterization : public ceres::Manifold {
 public:
  virtual bool ComputeJacobian(const double* x, double* jacobian) const = 0;
  virtual int GlobalSize() const = 0;
  virtual int LocalSize() const = 0;

  int AmbientSize() const final { return GlobalSize(); }
  int TangentSize() const final { return LocalSize(); }
  bool PlusJacobian(const double* x, double* jacobian) const final {
    return ComputeJacobian(x, jacobian);
  }
  // A solve needs neither.
  bool Minus(const double* /*y*/, const double* /*x*/, double* /*y_minus_x*/) const final {
    return false;
  }
  bool MinusJacobian(const double* /*x*/, double* /*jacobian*/) const final { return false; }
};

#endif

}  // namespace sliding_window
