#pragma once

#include <ceres/problem.h>
#include <ceres/version.h>

#if CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR == 0
#include <ceres/local_parameterization.h>
#else
#include <ceres/manifold.h>
#include <ceres/product_manifold.h>
#include <ceres/sphere_manifold.h>
#endif

/// Ceres's manifolds as tests write them, whatever the release calls them. 2.0 has them as
/// LocalParameterizations, without Minus.
namespace manifolds {

#if CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR == 0

using AnyManifold = ceres::LocalParameterization;

class Manifold : public ceres::LocalParameterization {
 public:
  virtual int AmbientSize() const = 0;
  virtual int TangentSize() const = 0;
  virtual bool PlusJacobian(const double* x, double* jacobian) const = 0;
  virtual bool Minus(const double* y, const double* x, double* y_minus_x) const = 0;
  virtual bool MinusJacobian(const double* x, double* jacobian) const = 0;

  int GlobalSize() const final { return AmbientSize(); }
  int LocalSize() const final { return TangentSize(); }
  bool ComputeJacobian(const double* x, double* jacobian) const final {
    return PlusJacobian(x, jacobian);
  }
};

using SubsetManifold = ceres::SubsetParameterization;
using QuaternionManifold = ceres::QuaternionParameterization;
using EigenQuaternionManifold = ceres::EigenQuaternionParameterization;

template <int kSize>
class SphereManifold : public ceres::HomogeneousVectorParameterization {
 public:
  SphereManifold() : ceres::HomogeneousVectorParameterization(kSize) {}
};

inline void Set(ceres::Problem* problem, double* block, AnyManifold* manifold) {
  problem->SetParameterization(block, manifold);
}
inline bool Has(const ceres::Problem& problem, const double* block) {
  return problem.GetParameterization(block) != nullptr;
}
/// Has the problem leave the deletion of its manifolds to others.
inline void Borrow(ceres::Problem::Options* options) {
  options->local_parameterization_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
}

#else

using AnyManifold = ceres::Manifold;
using ceres::EigenQuaternionManifold;
using ceres::Manifold;
using ceres::QuaternionManifold;
using ceres::SphereManifold;
using ceres::SubsetManifold;

inline void Set(ceres::Problem* problem, double* block, AnyManifold* manifold) {
  problem->SetManifold(block, manifold);
}
inline bool Has(const ceres::Problem& problem, const double* block) {
  return problem.HasManifold(block);
}
inline void Borrow(ceres::Problem::Options* options) {
  options->manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
}

#endif

}  // namespace manifolds
