#pragma once

#include <array>

#include <Eigen/Core>

namespace inceres::internal {

/// Where a feature is in the camera that saw it first: bearing (m_x, m_y, 1) and inverse depth λ,
/// 1/m.
struct Feature {
  std::array<double, 2> m{};
  double lambda = 0.0;
};

/// From the camera of a body at one pose, i, to the same camera at another, j: with Feature (m, λ)
/// at i, h = A m + λ b is λ times the point in the camera at j (body_reprojection.h).
struct RelativeCamera {
  RelativeCamera(const double* pose_i, const double* pose_j, const double* body_from_camera);

  Eigen::Vector3d Point(const Feature& feature) const;
  /// Where j sees the feature in the plane z = 1; false if not in front of it.
  bool Project(const Feature& feature, std::array<double, 2>* point) const;

  Eigen::Matrix3d A;
  Eigen::Vector3d b;
};

/// The point of a feature in the world; λ must not be 0.
Eigen::Vector3d PointInWorld(const Feature& feature, const double* pose,
                             const double* body_from_camera);

/// Gathers views of one feature and finds λ for the bearing of the first one: the least squares of
/// z_j × (A m + λ b) = 0.
class Triangulation {
 public:
  explicit Triangulation(const std::array<double, 2>& m) : m_(m) {}
  void AddView(const RelativeCamera& camera, const std::array<double, 2>& z);

  /// The largest distance of a view from where an infinitely far point would be seen.
  double parallax() const { return parallax_; }
  Feature Solve() const { return {m_, squares_ > 0.0 ? -product_ / squares_ : 0.0}; }

 private:
  std::array<double, 2> m_;
  double parallax_ = 0.0;
  double squares_ = 0.0;
  double product_ = 0.0;
};

}  // namespace inceres::internal
