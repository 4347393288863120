#include "common/imu_residual.h"

namespace sliding_window {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Imu = ImuPreintegration;

ImuState Propagate(const ImuPreintegration& imu, const ImuState& i) {
  const double dt = imu.dt();
  ImuState j = i;
  j.pose.p = i.pose.p + i.v * dt - 0.5 * dt * dt * kGravity + i.pose.q * imu.delta_p();
  j.pose.q = (i.pose.q * imu.delta_q()).normalized();
  j.v = i.v - dt * kGravity + i.pose.q * imu.delta_v();
  return j;
}

void EvaluateImuResidual(const ImuPreintegration& imu, const ImuState& i, const ImuState& j,
                         Imu::Vector15* r, Imu::Matrix15* J_i, Imu::Matrix15* J_j) {
  const double dt = imu.dt();
  const Imu::Matrix15& D = imu.jacobian();
  const Vector3d dba = i.ba - imu.ba();
  const Vector3d dbg = i.bg - imu.bg();
  const Vector3d turn = D.block<3, 3>(Imu::kTheta, Imu::kBg) * dbg;
  const Quaterniond delta_q = imu.delta_q() * Exp(turn);

  const Matrix3d R_i_inv = i.pose.q.conjugate().toRotationMatrix();
  const Vector3d way = R_i_inv * (j.pose.p - i.pose.p - i.v * dt + 0.5 * dt * dt * kGravity);
  const Vector3d gain = R_i_inv * (j.v - i.v + dt * kGravity);
  const Quaterniond e = delta_q.conjugate() * i.pose.q.conjugate() * j.pose.q;
  for (const auto& [row, measured] :
       {std::pair(Imu::kP, imu.delta_p()), std::pair(Imu::kV, imu.delta_v())}) {
    r->segment<3>(row) = (row == Imu::kP ? way : gain) - measured -
                         D.block<3, 3>(row, Imu::kBa) * dba - D.block<3, 3>(row, Imu::kBg) * dbg;
  }
  r->segment<3>(Imu::kTheta) = 2.0 * e.vec();
  r->segment<3>(Imu::kBa) = j.ba - i.ba;
  r->segment<3>(Imu::kBg) = j.bg - i.bg;
  *r = imu.sqrt_information() * *r;
  if (J_i == nullptr) {
    return;
  }

  // 2 vec(e dq) = 2 vec(e) + from_right theta for dq = Exp(theta); likewise 2 vec(dq e) from the
  // left.
  const Matrix3d from_right = e.w() * Matrix3d::Identity() + Skew(e.vec());
  const Matrix3d from_left = e.w() * Matrix3d::Identity() - Skew(e.vec());
  J_i->setZero();
  J_i->block<3, 3>(Imu::kP, Imu::kP) = -R_i_inv;
  J_i->block<3, 3>(Imu::kP, Imu::kTheta) = Skew(way);
  J_i->block<3, 3>(Imu::kP, Imu::kV) = -dt * R_i_inv;
  J_i->block<3, 3>(Imu::kTheta, Imu::kTheta) = -from_left * delta_q.conjugate().toRotationMatrix();
  J_i->block<3, 3>(Imu::kTheta, Imu::kBg) =
      -from_left * RightJacobian(turn) * D.block<3, 3>(Imu::kTheta, Imu::kBg);
  J_i->block<3, 3>(Imu::kV, Imu::kTheta) = Skew(gain);
  J_i->block<3, 3>(Imu::kV, Imu::kV) = -R_i_inv;
  for (const int row : {Imu::kP, Imu::kV}) {
    J_i->block<3, 6>(row, Imu::kBa) = -D.block<3, 6>(row, Imu::kBa);
  }
  J_i->block<6, 6>(Imu::kBa, Imu::kBa) -= Eigen::Matrix<double, 6, 6>::Identity();
  *J_i = imu.sqrt_information() * *J_i;

  J_j->setZero();
  J_j->block<3, 3>(Imu::kP, Imu::kP) = R_i_inv;
  J_j->block<3, 3>(Imu::kTheta, Imu::kTheta) = from_right;
  J_j->block<3, 3>(Imu::kV, Imu::kV) = R_i_inv;
  J_j->block<6, 6>(Imu::kBa, Imu::kBa).setIdentity();
  *J_j = imu.sqrt_information() * *J_j;
}

}  // namespace sliding_window
