#include "okvis/realistic_errors.h"

#include "common/imu_in_full.h"
#include "common/linearize.h"
#include "common/pose.h"
#include "okvis/imu_error.h"
#include "okvis/manifolds.h"

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector4d;
using Imu = ImuPreintegration;
using Matrix24 = Eigen::Matrix<double, 2, 4>;

namespace {

constexpr double kNearestDepth = 0.2;  // m
constexpr double kMaxBiasTurn = 1e-4;  // rad, as in ImuError

// From source to target, as a matrix on homogeneous points.
Matrix4d ToMatrix(const Pose& pose) {
  Matrix4d T = Matrix4d::Identity();
  T.topLeftCorner<3, 3>() = pose.q.toRotationMatrix();
  T.topRightCorner<3, 1>() = pose.p;
  return T;
}

Matrix4d InverseOf(const Matrix4d& T) {
  Matrix4d inverse = Matrix4d::Identity();
  inverse.topLeftCorner<3, 3>() = T.topLeftCorner<3, 3>().transpose();
  inverse.topRightCorner<3, 1>() = -T.topLeftCorner<3, 3>().transpose() * T.topRightCorner<3, 1>();
  return inverse;
}

// d (T^-1 point) / d (p, theta) of T, world axes.
MatrixXd InverseJacobian(const Matrix4d& T_inverse, const Vector3d& p, const Vector4d& point) {
  MatrixXd J = MatrixXd::Zero(4, 6);
  const Matrix3d C = T_inverse.topLeftCorner<3, 3>();
  J.topLeftCorner<3, 3>() = -C * point[3];
  J.topRightCorner<3, 3>() = C * Skew(point.head<3>() - p * point[3]);
  return J;
}

// PoseManifold::Lift, its quaternion's part as the product that it is: of the derivative of the
// turn by the quaternion q q_0^-1, and of that by q (x, y, z, w).
PoseManifold::LiftMatrix LiftInFull(const Pose& pose) {
  const Eigen::Quaterniond inverse = pose.q.inverse();
  Eigen::Matrix<double, 3, 4> by_product = Eigen::Matrix<double, 3, 4>::Zero();
  by_product.leftCols<3>().diagonal().setConstant(2.0);
  Matrix4d product;  // q q_0^-1 = product q
  product << inverse.w() * Matrix3d::Identity() - Skew(inverse.vec()), inverse.vec(),
      -inverse.vec().transpose(), inverse.w();
  PoseManifold::LiftMatrix lift = PoseManifold::LiftMatrix::Zero();
  lift.topLeftCorner<3, 3>().setIdentity();
  lift.bottomRightCorner<3, 4>() = by_product * product;
  return lift;
}

void WriteLifted(const MatrixXd& minimal, const Pose& pose, double* jacobian) {
  Eigen::Map<RowMajorMatrix>(jacobian, 2, 7) = minimal * LiftInFull(pose);
}

}  // namespace

Vector2d DistortedCamera::Project(const Vector4d& point, Matrix24* jacobian) const {
  const double z_inv = 1.0 / point[2];
  const double x = point[0] * z_inv;
  const double y = point[1] * z_inv;
  const double xx = x * x;
  const double yy = y * y;
  const double xy = x * y;
  const double rr = xx + yy;
  const double k1 = distortion[0];
  const double k2 = distortion[1];
  const double p1 = distortion[2];
  const double p2 = distortion[3];
  const double radial = k1 * rr + k2 * rr * rr;
  const Vector2d distorted(x + x * radial + 2.0 * p1 * xy + p2 * (rr + 2.0 * xx),
                           y + y * radial + 2.0 * p2 * xy + p1 * (rr + 2.0 * yy));
  if (jacobian != nullptr) {
    const double radial_1 = 2.0 * (k1 + 2.0 * k2 * rr);  // d radial / d x = radial_1 x
    Eigen::Matrix2d by_plane;
    by_plane << 1.0 + radial + radial_1 * xx + 2.0 * p1 * y + 6.0 * p2 * x,
        radial_1 * xy + 2.0 * p1 * x + 2.0 * p2 * y, radial_1 * xy + 2.0 * p2 * y + 2.0 * p1 * x,
        1.0 + radial + radial_1 * yy + 2.0 * p2 * x + 6.0 * p1 * y;
    Matrix24 plane_by_point = Matrix24::Zero();
    plane_by_point << z_inv, 0.0, -x * z_inv, 0.0, 0.0, z_inv, -y * z_inv, 0.0;
    *jacobian = focal_length * by_plane * plane_by_point;
  }
  return focal_length * distorted + center;
}

RealisticReprojectionError::RealisticReprojectionError(const Vector2d& xy, double focal_length,
                                                       double pixel_sigma)
    : camera_{focal_length, Vector2d::Zero(), Vector4d::Zero()},
      keypoint_(focal_length * xy),
      sqrt_information_(Eigen::Matrix2d::Identity() / pixel_sigma) {
}

bool RealisticReprojectionError::Evaluate(double const* const* parameters, double* residuals,
                                          double** jacobians) const {
  const Pose pose = Pose::FromParameters(parameters[0]);
  const Pose extrinsic = Pose::FromParameters(parameters[2]);
  const Matrix4d T_sw = InverseOf(ToMatrix(pose));
  const Matrix4d T_cs = InverseOf(ToMatrix(extrinsic));
  const Vector4d in_world(parameters[1]);
  const Vector4d in_body = T_sw * in_world;
  const Vector4d in_camera = T_cs * in_body;

  Matrix24 by_point;
  const Vector2d image = camera_.Project(in_camera, jacobians != nullptr ? &by_point : nullptr);
  Eigen::Map<Vector2d>{residuals} = sqrt_information_ * (image - keypoint_);
  if (jacobians == nullptr) {
    return true;
  }
  Matrix24 weighted = sqrt_information_ * by_point;
  if (in_camera[2] < kNearestDepth * in_world[3]) {
    weighted.setZero();
  }
  if (jacobians[0] != nullptr) {
    WriteLifted(weighted * T_cs * InverseJacobian(T_sw, pose.p, in_world), pose, jacobians[0]);
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 2, 4, Eigen::RowMajor>>{jacobians[1]} = weighted * T_cs * T_sw;
  }
  if (jacobians[2] != nullptr) {
    WriteLifted(weighted * InverseJacobian(T_cs, extrinsic.p, in_body), extrinsic, jacobians[2]);
  }
  return true;
}

namespace {

// F has columns p, theta (body axes), v, ba, bg.
void WriteJacobians(const Imu::Matrix15& W, const Imu::Matrix15& F, const Pose& pose,
                    double* pose_jacobian, double* speed_bias_jacobian) {
  if (pose_jacobian != nullptr) {
    Eigen::Matrix<double, 15, 6> F_pose = F.leftCols<6>();
    F_pose.rightCols<3>() *= pose.q.toRotationMatrix().transpose();
    const Eigen::Matrix<double, 15, 6> minimal = W * F_pose;
    Eigen::Map<Eigen::Matrix<double, 15, 7, Eigen::RowMajor>>{pose_jacobian} =
        minimal * PoseManifold::Lift(pose);
  }
  if (speed_bias_jacobian != nullptr) {
    Eigen::Matrix<double, 15, 9> F_speed_bias;
    F_speed_bias << F.middleCols<3>(Imu::kV), F.middleCols<3>(Imu::kBg), F.middleCols<3>(Imu::kBa);
    Eigen::Map<Eigen::Matrix<double, 15, 9, Eigen::RowMajor>>{speed_bias_jacobian} =
        W * F_speed_bias;
  }
}

}  // namespace

bool RealisticImuError::Evaluate(double const* const* parameters, double* residuals,
                                 double** jacobians) const {
  const ImuState i = StateFromBlocks(parameters[0], parameters[1]);
  const ImuState j = StateFromBlocks(parameters[2], parameters[3]);
  const std::lock_guard<std::mutex> lock(mutex_);
  if ((i.bg - imu_.bg()).norm() * imu_.dt() > kMaxBiasTurn) {
    imu_.Repropagate(i.ba, i.bg);
  }
  const FullImuResidual full = EvaluateInFull(imu_, i, j, jacobians != nullptr);
  const Imu::Matrix15& W = imu_.sqrt_information();
  Eigen::Map<Imu::Vector15>{residuals} = W * full.e;
  if (jacobians != nullptr) {
    WriteJacobians(W, full.F_i, i.pose, jacobians[0], jacobians[1]);
    WriteJacobians(W, full.F_j, j.pose, jacobians[2], jacobians[3]);
  }
  return true;
}

}  // namespace sliding_window
