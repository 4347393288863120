#include "vins/realistic_factors.h"

#include "common/imu_in_full.h"
#include "common/pose.h"
#include "vins/imu_factor.h"

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Imu = ImuPreintegration;

namespace {

void WriteWeightedImu(const Imu::Matrix15& W, const Imu::Matrix15& F, double* pose_jacobian,
                      double* speed_bias_jacobian) {
  if (pose_jacobian != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 15, 7, Eigen::RowMajor>> J(pose_jacobian);
    J.setZero();
    J.leftCols<6>() = F.leftCols<6>();
    J = W * J;
  }
  if (speed_bias_jacobian != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 15, 9, Eigen::RowMajor>> J(speed_bias_jacobian);
    J = F.rightCols<9>();
    J = W * J;
  }
}

void WriteReduced(const Eigen::MatrixXd& reduce, const Eigen::MatrixXd& by_pose, double* jacobian) {
  Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> J(jacobian);
  J.leftCols<6>() = reduce * by_pose;
  J.rightCols<1>().setZero();
}

}  // namespace

bool RealisticImuFactor::Evaluate(double const* const* parameters, double* residuals,
                                  double** jacobians) const {
  const ImuState i = StateFromParameters(parameters[0], parameters[1]);
  const ImuState j = StateFromParameters(parameters[2], parameters[3]);
  const FullImuResidual full = EvaluateInFull(*imu_, i, j, jacobians != nullptr);
  const Imu::Matrix15 W = SqrtInformationOf(imu_->covariance());
  Eigen::Map<Imu::Vector15>{residuals} = W * full.e;
  if (jacobians != nullptr) {
    WriteWeightedImu(W, full.F_i, jacobians[0], jacobians[1]);
    WriteWeightedImu(W, full.F_j, jacobians[2], jacobians[3]);
  }
  return true;
}

bool RealisticProjectionFactor::Evaluate(double const* const* parameters, double* residuals,
                                         double** jacobians) const {
  const Pose i = Pose::FromParameters(parameters[0]);
  const Pose j = Pose::FromParameters(parameters[1]);
  const Pose c = Pose::FromParameters(parameters[2]);
  const double lambda = parameters[3][0];

  const Vector3d in_camera_i = point_i_ / lambda;
  const Vector3d in_body_i = c.q * in_camera_i + c.p;
  const Vector3d in_world = i.q * in_body_i + i.p;
  const Vector3d in_body_j = j.q.inverse() * (in_world - j.p);
  const Vector3d x = c.q.inverse() * (in_body_j - c.p);
  Eigen::Map<Eigen::Vector2d>{residuals} =
      sqrt_information_ * ((x / x.z()).head<2>() - point_j_.head<2>());
  if (jacobians == nullptr) {
    return true;
  }

  const Matrix3d R_i = i.q.toRotationMatrix();
  const Matrix3d R_j = j.q.toRotationMatrix();
  const Matrix3d R_c = c.q.toRotationMatrix();
  Eigen::MatrixXd reduce(2, 3);
  reduce << 1.0 / x.z(), 0.0, -x.x() / (x.z() * x.z()), 0.0, 1.0 / x.z(), -x.y() / (x.z() * x.z());
  reduce = sqrt_information_ * reduce;
  Eigen::MatrixXd by_pose(3, 6);
  if (jacobians[0] != nullptr) {
    by_pose.leftCols(3) = R_c.transpose() * R_j.transpose();
    by_pose.rightCols(3) = R_c.transpose() * R_j.transpose() * R_i * -Skew(in_body_i);
    WriteReduced(reduce, by_pose, jacobians[0]);
  }
  if (jacobians[1] != nullptr) {
    by_pose.leftCols(3) = R_c.transpose() * -R_j.transpose();
    by_pose.rightCols(3) = R_c.transpose() * Skew(in_body_j);
    WriteReduced(reduce, by_pose, jacobians[1]);
  }
  if (jacobians[2] != nullptr) {
    const Matrix3d there_and_back = R_c.transpose() * R_j.transpose() * R_i * R_c;
    by_pose.leftCols(3) = R_c.transpose() * (R_j.transpose() * R_i - Matrix3d::Identity());
    by_pose.rightCols(3) = Skew(x) - there_and_back * Skew(in_camera_i);
    WriteReduced(reduce, by_pose, jacobians[2]);
  }
  if (jacobians[3] != nullptr) {
    Eigen::Map<Eigen::Vector2d>{jacobians[3]} = reduce * R_c.transpose() * R_j.transpose() * R_i *
                                                R_c * point_i_ * -1.0 / (lambda * lambda);
  }
  return true;
}

}  // namespace sliding_window
