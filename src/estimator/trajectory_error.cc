#include "inceres/estimator/trajectory_error.h"

#include <cmath>

#include <Eigen/Core>
#include <Eigen/Geometry>

// Errors of a trajectory as the evo tool defines them, so that numbers compare with those of
// papers: absolute after an alignment (Sturm et al. 2012), relative between pairs of poses. A world
// that is only known up to rotation and translation does not count against an estimate in either;
// scale does. Which pairs are taken is evo's choice too: consecutive ones that share no stretch,
// not all pairs.

namespace inceres {
namespace {

// [p(3), q(x, y, z, w)]; Eigen's quaternion takes w first.
Eigen::Isometry3d PoseOf(const std::array<double, 7>& pose) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(pose[0], pose[1], pose[2]);
  T.linear() = Eigen::Quaterniond(pose[6], pose[3], pose[4], pose[5]).toRotationMatrix();
  return T;
}

Eigen::Matrix3Xd PlacesOf(const Trajectory& trajectory) {
  Eigen::Matrix3Xd places(3, static_cast<Eigen::Index>(trajectory.size()));
  for (Eigen::Index i = 0; i < places.cols(); ++i) {
    places.col(i) = PoseOf(trajectory[static_cast<std::size_t>(i)]).translation();
  }
  return places;
}

// Between consecutive indices.
// The root mean squares of translation and angle of (T_i⁻¹ T_j)⁻¹ (truth) times the same of the
// estimate: the motion is compared in the frame of i, so errors before i have no share in it.
RelativePoseError ErrorBetween(const Trajectory& estimate, const Trajectory& truth,
                               const std::vector<std::size_t>& indices) {
  RelativePoseError error;
  for (std::size_t k = 1; k < indices.size(); ++k) {
    const std::size_t i = indices[k - 1], j = indices[k];
    const Eigen::Isometry3d true_motion = PoseOf(truth[i]).inverse() * PoseOf(truth[j]);
    // Multiplied from the left by the inverse of the true motion: the error stands in the frame of
    // j.
    const Eigen::Isometry3d difference =
        true_motion.inverse() * (PoseOf(estimate[i]).inverse() * PoseOf(estimate[j]));
    const double degrees = Eigen::AngleAxisd(difference.rotation()).angle() * 180.0 / M_PI;
    error.translation += difference.translation().squaredNorm();
    error.rotation_degrees += degrees * degrees;
    ++error.num_pairs;
  }
  // No pair, no error: zeros with num_pairs 0, not NaN.
  if (error.num_pairs > 0) {
    error.translation = std::sqrt(error.translation / error.num_pairs);
    error.rotation_degrees = std::sqrt(error.rotation_degrees / error.num_pairs);
  }
  return error;
}

}  // namespace

double AbsoluteTrajectoryError(const Trajectory& estimate, const Trajectory& truth) {
  const Eigen::Matrix3Xd places = PlacesOf(estimate), true_places = PlacesOf(truth);
  // Umeyama's closed form by an SVD of the cross-covariance, without scale: a visual-inertial
  // estimate has a scale of its own, which is part of what is judged.
  const Eigen::Matrix4d T = Eigen::umeyama(places, true_places, false);
  const Eigen::Matrix3Xd aligned =
      (T.topLeftCorner<3, 3>() * places).colwise() + T.topRightCorner<3, 1>();
  return std::sqrt((aligned - true_places).squaredNorm() / static_cast<double>(places.cols()));
}

RelativePoseError RelativePoseErrorOverFrames(const Trajectory& estimate, const Trajectory& truth,
                                              int frames) {
  std::vector<std::size_t> indices;
  for (std::size_t i = 0; i < estimate.size(); i += static_cast<std::size_t>(frames)) {
    // A rest of fewer than `frames` poses at the end has no pair.
    indices.push_back(i);
  }
  return ErrorBetween(estimate, truth, indices);
}

RelativePoseError RelativePoseErrorOverPath(const Trajectory& estimate, const Trajectory& truth,
                                            double meters) {
  // Pairs begin where the path first reaches the length, not at pose 0, and each piece is measured
  // from zero again: evo's rule, by which what a step goes beyond the length is not carried over.
  std::vector<std::size_t> indices;
  double path = 0.0;
  for (std::size_t i = 1; i < estimate.size(); ++i) {
    path += (PoseOf(estimate[i]).translation() - PoseOf(estimate[i - 1]).translation()).norm();
    if (path >= meters) {
      indices.push_back(i);
      path = 0.0;
    }
  }
  return ErrorBetween(estimate, truth, indices);
}

}  // namespace inceres
