#include "common/trajectory_error.h"

#include <cmath>

#include <Eigen/Geometry>

namespace sliding_window {

double AbsoluteTrajectoryError(const std::vector<Eigen::Vector3d>& estimated,
                               const std::vector<Eigen::Vector3d>& truth) {
  const auto n = static_cast<Eigen::Index>(estimated.size());
  const Eigen::Matrix3Xd from = Eigen::Map<const Eigen::Matrix3Xd>(estimated.front().data(), 3, n);
  const Eigen::Matrix3Xd to = Eigen::Map<const Eigen::Matrix3Xd>(truth.front().data(), 3, n);
  const Eigen::Matrix4d T = Eigen::umeyama(from, to, /*with_scaling=*/false);
  const Eigen::Matrix3Xd difference =
      ((T.topLeftCorner<3, 3>() * from).colwise() + T.topRightCorner<3, 1>()) - to;
  return std::sqrt(difference.squaredNorm() / static_cast<double>(n));
}

}  // namespace sliding_window
