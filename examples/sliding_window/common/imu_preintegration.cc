#include "common/imu_preintegration.h"

#include <Eigen/Cholesky>

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Vector3d;

ImuPreintegration::ImuPreintegration(const ImuNoise& noise, const std::vector<ImuSample>& samples,
                                     const Vector3d& ba, const Vector3d& bg)
    : noise_(noise), samples_(samples) {
  Repropagate(ba, bg);
}

void ImuPreintegration::Append(const std::vector<ImuSample>& samples) {
  for (std::size_t i = 1; i < samples.size(); ++i) {
    Step(samples_.back(), samples[i]);
    samples_.push_back(samples[i]);
  }
  UpdateSqrtInformation();
}

void ImuPreintegration::Repropagate(const Vector3d& ba, const Vector3d& bg) {
  Reset(ba, bg);
  for (std::size_t i = 1; i < samples_.size(); ++i) {
    Step(samples_[i - 1], samples_[i]);
  }
  UpdateSqrtInformation();
}

void ImuPreintegration::Reset(const Vector3d& ba, const Vector3d& bg) {
  ba_ = ba;
  bg_ = bg;
  delta_p_.setZero();
  delta_v_.setZero();
  delta_q_.setIdentity();
  jacobian_.setIdentity();
  covariance_.setZero();
}

void ImuPreintegration::Step(const ImuSample& from, const ImuSample& to) {
  const double dt = to.time - from.time;
  const Vector3d a_0 = from.acc - ba_;
  const Vector3d a_1 = to.acc - ba_;
  const Vector3d turn = (0.5 * (from.gyr + to.gyr) - bg_) * dt;
  const Eigen::Quaterniond dq = Exp(turn);
  const Matrix3d R_0 = delta_q_.toRotationMatrix();
  delta_q_ = (delta_q_ * dq).normalized();
  const Matrix3d R_1 = delta_q_.toRotationMatrix();
  const Vector3d a = 0.5 * (R_0 * a_0 + R_1 * a_1);
  delta_p_ += delta_v_ * dt + 0.5 * dt * dt * a;
  delta_v_ += dt * a;

  // First order: theta_1 = dR^T theta_0 - J_r dt bg, and the mean acceleration a moves with
  // theta_0, theta_1 and ba.
  const Matrix3d theta_theta = dq.conjugate().toRotationMatrix();
  const Matrix3d theta_bg = -dt * RightJacobian(turn);
  const Matrix3d a_theta_1 = -0.5 * R_1 * Skew(a_1);
  const Matrix3d a_theta = -0.5 * R_0 * Skew(a_0) + a_theta_1 * theta_theta;
  const Matrix3d a_ba = -0.5 * (R_0 + R_1);
  const Matrix3d a_bg = a_theta_1 * theta_bg;

  Matrix15 F = Matrix15::Identity();
  F.block<3, 3>(kP, kV) = dt * Matrix3d::Identity();
  F.block<3, 3>(kTheta, kTheta) = theta_theta;
  F.block<3, 3>(kTheta, kBg) = theta_bg;
  for (const auto& [row, factor] : {std::pair(kP, 0.5 * dt * dt), std::pair(kV, dt)}) {
    F.block<3, 3>(row, kTheta) = factor * a_theta;
    F.block<3, 3>(row, kBa) = factor * a_ba;
    F.block<3, 3>(row, kBg) = factor * a_bg;
  }
  jacobian_ = F * jacobian_;

  // The sensors' white noise enters where the biases do; its variance over one sample is density^2
  // / dt.
  const double acc_variance = noise_.acc * noise_.acc / dt;
  const double gyr_variance = noise_.gyr * noise_.gyr / dt;
  Eigen::Matrix<double, 9, 6> G = F.block<9, 6>(0, kBa);
  const Eigen::Matrix<double, 9, 3> G_acc = G.leftCols<3>();
  const Eigen::Matrix<double, 9, 3> G_gyr = G.rightCols<3>();
  covariance_ = F * covariance_ * F.transpose();
  covariance_.topLeftCorner<9, 9>() +=
      acc_variance * G_acc * G_acc.transpose() + gyr_variance * G_gyr * G_gyr.transpose();
  covariance_.block<3, 3>(kBa, kBa).diagonal().array() +=
      noise_.acc_bias_walk * noise_.acc_bias_walk * dt;
  covariance_.block<3, 3>(kBg, kBg).diagonal().array() +=
      noise_.gyr_bias_walk * noise_.gyr_bias_walk * dt;
}

void ImuPreintegration::UpdateSqrtInformation() {
  // covariance = L L^T, so W = L^-1.
  const Eigen::LLT<Matrix15> llt(covariance_);
  sqrt_information_ = llt.matrixL().solve(Matrix15::Identity());
}

}  // namespace sliding_window
