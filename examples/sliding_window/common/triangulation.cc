#include "common/triangulation.h"

#include <Eigen/Eigenvalues>

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Vector3d;

std::optional<Vector3d> Triangulate(const std::vector<Sight>& sights) {
  constexpr double kMinParallax2 = 1e-3;  // squared radians: 2.6 degrees between two lines
  constexpr double kMinDepth = 0.1;
  Matrix3d A = Matrix3d::Zero();
  Vector3d b = Vector3d::Zero();
  for (const Sight& sight : sights) {
    const Vector3d direction = (sight.world_from_camera.q * sight.xy.homogeneous()).normalized();
    const Matrix3d across = Matrix3d::Identity() - direction * direction.transpose();
    A += across;
    b += across * sight.world_from_camera.p;
  }
  // Along parallel lines A is singular: its smallest eigenvalue is the sum of squared angles to the
  // mean direction.
  const Eigen::SelfAdjointEigenSolver<Matrix3d> eigen(A);
  if (eigen.eigenvalues()[0] < kMinParallax2) {
    return std::nullopt;
  }
  const Vector3d point = eigen.eigenvectors() *
                         (eigen.eigenvectors().transpose() * b).cwiseQuotient(eigen.eigenvalues());
  for (const Sight& sight : sights) {
    if ((sight.world_from_camera.Inverse() * point).z() < kMinDepth) {
      return std::nullopt;
    }
  }
  return point;
}

}  // namespace sliding_window
