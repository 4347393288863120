#include "common/imu_in_full.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Matrix4d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Imu = ImuPreintegration;

namespace {

// LeftMatrix(a) b = a b = RightMatrix(b) a for quaternions as (w, x, y, z).
Matrix4d LeftMatrix(const Quaterniond& q) {
  Matrix4d L;
  L << q.w(), -q.vec().transpose(), q.vec(), q.w() * Matrix3d::Identity() + Skew(q.vec());
  return L;
}

Matrix4d RightMatrix(const Quaterniond& q) {
  Matrix4d R;
  R << q.w(), -q.vec().transpose(), q.vec(), q.w() * Matrix3d::Identity() - Skew(q.vec());
  return R;
}

struct Corrected {
  Quaterniond q;
  Vector3d p, v, turn;
};

// The deltas at the biases of state i, to first order.
Corrected Correct(const Imu& imu, const ImuState& i) {
  const Vector3d dba = i.ba - imu.ba();
  const Vector3d dbg = i.bg - imu.bg();
  const auto D = [&imu](int row, int column) -> Matrix3d {
    return imu.jacobian().block<3, 3>(row, column);
  };
  const Vector3d turn = D(Imu::kTheta, Imu::kBg) * dbg;
  return {imu.delta_q() * Exp(turn),
          imu.delta_p() + D(Imu::kP, Imu::kBa) * dba + D(Imu::kP, Imu::kBg) * dbg,
          imu.delta_v() + D(Imu::kV, Imu::kBa) * dba + D(Imu::kV, Imu::kBg) * dbg, turn};
}

void SetJacobians(const Imu& imu, const ImuState& i, const ImuState& j, const Corrected& delta,
                  FullImuResidual* full) {
  const double dt = imu.dt();
  const auto D = [&imu](int row, int column) -> Matrix3d {
    return imu.jacobian().block<3, 3>(row, column);
  };
  const Quaterniond e = delta.q.inverse() * i.pose.q.inverse() * j.pose.q;
  Imu::Matrix15& F_i = full->F_i;
  F_i.setZero();
  F_i.block<3, 3>(Imu::kP, Imu::kP) = -i.pose.q.inverse().toRotationMatrix();
  F_i.block<3, 3>(Imu::kP, Imu::kTheta) =
      Skew(i.pose.q.inverse() * (j.pose.p - i.pose.p - i.v * dt + 0.5 * dt * dt * kGravity));
  F_i.block<3, 3>(Imu::kP, Imu::kV) = -i.pose.q.inverse().toRotationMatrix() * dt;
  F_i.block<3, 3>(Imu::kTheta, Imu::kTheta) =
      -(LeftMatrix(delta.q.inverse()) * RightMatrix(i.pose.q.inverse() * j.pose.q))
           .bottomRightCorner<3, 3>();
  F_i.block<3, 3>(Imu::kTheta, Imu::kBg) = -RightMatrix(e).bottomRightCorner<3, 3>() *
                                           RightJacobian(delta.turn) * D(Imu::kTheta, Imu::kBg);
  F_i.block<3, 3>(Imu::kV, Imu::kTheta) = Skew(i.pose.q.inverse() * (j.v - i.v + dt * kGravity));
  F_i.block<3, 3>(Imu::kV, Imu::kV) = -i.pose.q.inverse().toRotationMatrix();
  for (const int row : {Imu::kP, Imu::kV}) {
    F_i.block<3, 3>(row, Imu::kBa) = -D(row, Imu::kBa);
    F_i.block<3, 3>(row, Imu::kBg) = -D(row, Imu::kBg);
  }
  F_i.block<3, 3>(Imu::kBa, Imu::kBa) = -Matrix3d::Identity();
  F_i.block<3, 3>(Imu::kBg, Imu::kBg) = -Matrix3d::Identity();

  Imu::Matrix15& F_j = full->F_j;
  F_j.setZero();
  F_j.block<3, 3>(Imu::kP, Imu::kP) = i.pose.q.inverse().toRotationMatrix();
  F_j.block<3, 3>(Imu::kTheta, Imu::kTheta) = LeftMatrix(e).bottomRightCorner<3, 3>();
  F_j.block<3, 3>(Imu::kV, Imu::kV) = i.pose.q.inverse().toRotationMatrix();
  F_j.block<3, 3>(Imu::kBa, Imu::kBa) = Matrix3d::Identity();
  F_j.block<3, 3>(Imu::kBg, Imu::kBg) = Matrix3d::Identity();
}

}  // namespace

FullImuResidual EvaluateInFull(const Imu& imu, const ImuState& i, const ImuState& j,
                               bool with_jacobians) {
  const double dt = imu.dt();
  const Corrected delta = Correct(imu, i);
  FullImuResidual full;
  full.e.segment<3>(Imu::kP) =
      i.pose.q.inverse() * (j.pose.p - i.pose.p - i.v * dt + 0.5 * dt * dt * kGravity) - delta.p;
  full.e.segment<3>(Imu::kTheta) =
      2.0 * (delta.q.inverse() * (i.pose.q.inverse() * j.pose.q)).vec();
  full.e.segment<3>(Imu::kV) = i.pose.q.inverse() * (j.v - i.v + dt * kGravity) - delta.v;
  full.e.segment<3>(Imu::kBa) = j.ba - i.ba;
  full.e.segment<3>(Imu::kBg) = j.bg - i.bg;
  if (with_jacobians) {
    SetJacobians(imu, i, j, delta, &full);
  }
  return full;
}

Imu::Matrix15 SqrtInformationOf(const Imu::Matrix15& covariance) {
  // W is lower triangular: the factor of the inverse with rows and columns in reverse, reversed
  // back.
  const Imu::Matrix15 information = covariance.inverse();
  const Imu::Matrix15 L = Eigen::LLT<Imu::Matrix15>(information.reverse()).matrixL();
  return L.transpose().reverse();
}

}  // namespace sliding_window
