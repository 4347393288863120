#include <algorithm>
#include <cmath>

#include "factors/imu_correction.h"
#include "factors/imu_layout.h"
#include "inceres/factors/imu_preintegrator.h"
#include "problem/find_fault.h"

namespace inceres {

using internal::AllFinite;
using internal::AsVector;
using internal::CorrectedDelta;
using internal::ImuLayout;
using internal::Matrix;
using internal::Matrix3;
using internal::Skew;
using internal::Vector3;

namespace {

// Of the step in the parts' own order, (φ, v, p, b_g, b_a) perturbed on the right:
//     F = ∂(state j)/∂(state i),   G = ∂(state j)/∂(error of Δ).
void Linearize(const CorrectedDelta& delta, const Matrix3& R_i, double dt, Matrix<15, 15>* F,
               Matrix<15, 15>* G) {
  using namespace internal;  // NOLINT(google-build-using-namespace): the names of the parts
  G->setIdentity();
  G->block<3, 3>(kDeltaV, kDeltaV) = R_i;
  G->block<3, 3>(kDeltaP, kDeltaP) = R_i;
  F->setIdentity();
  F->block<3, 3>(kDeltaPhi, kDeltaPhi) = RotationOf(delta.q).transpose();
  F->block<3, 3>(kDeltaV, kDeltaPhi) = -R_i * Skew(delta.v);
  F->block<3, 3>(kDeltaP, kDeltaPhi) = -R_i * Skew(delta.p);
  F->block<3, 3>(kDeltaP, kDeltaV) = dt * Matrix3::Identity();
  F->block<3, 3>(kDeltaPhi, kDeltaGyrBias) = delta.phi_gyr_bias;
  F->block<6, 6>(kDeltaV, kDeltaGyrBias) = G->block<6, 6>(kDeltaV, kDeltaV) * delta.motion_bias;
}

}  // namespace

Status PropagateImu(const ImuPreintegrator& imu, const double* pose, const double* speed_bias,
                    const double* covariance, double* next_pose, double* next_speed_bias,
                    double* next_covariance) {
  if (imu.samples().empty()) {
    return internal::Invalid("nothing was integrated to propagate a state with");
  }
  if (!AllFinite(pose, 7) || !AllFinite(speed_bias, 9) ||
      (covariance != nullptr && !AllFinite(covariance, 225))) {
    return internal::Invalid("the state to propagate, or its covariance, is not finite");
  }
  const ImuConventions& conventions = imu.options().conventions;
  const ImuLayout rows = internal::StateLayoutOf(conventions);
  const double dt = imu.delta().dt;
  const Vector3 g = AsVector(conventions.gravity);
  const CorrectedDelta delta = internal::Correct(imu.delta(), speed_bias + rows.gyr_column,
                                                 speed_bias + rows.acc_column, /*jacobians=*/true);
  const Matrix3 R_i = internal::RotationOf(pose + 3);
  double q_j[4];
  MultiplyQuaternions(pose + 3, delta.q, q_j);

  if (covariance != nullptr && next_covariance != nullptr) {
    Matrix<15, 15> F, G;
    Linearize(delta, R_i, dt, &F, &G);
    // φ on the left is R φ on the right, so C and its inverse are each other's transposes.
    const bool left = conventions.perturbation == ImuConventions::Perturbation::kLeft;
    const Matrix3 identity = Matrix3::Identity();
    const Matrix<15, 15> C_i = internal::PartMap(rows, left ? R_i : identity);
    const Matrix<15, 15> C_j = internal::PartMap(rows, left ? internal::RotationOf(q_j) : identity);
    const Eigen::Map<const Matrix<15, 15>> P_i(covariance);
    const Eigen::Map<const Matrix<15, 15>> noise(imu.delta().covariance);
    F = (C_j * F * C_i.transpose()).eval();
    G = (C_j * G).eval();
    const Matrix<15, 15> P_j = F * P_i * F.transpose() + G * noise * G.transpose();
    Eigen::Map<Matrix<15, 15>>{next_covariance} = 0.5 * (P_j + P_j.transpose());
  }

  const Vector3 v_i = AsVector(speed_bias);
  const Vector3 p_j = AsVector(pose) + dt * v_i + 0.5 * dt * dt * g + R_i * delta.p;
  const Vector3 v_j = v_i + dt * g + R_i * delta.v;
  std::copy_n(p_j.data(), 3, next_pose);
  std::copy_n(q_j, 4, next_pose + 3);
  std::copy_n(v_j.data(), 3, next_speed_bias);
  if (next_speed_bias != speed_bias) {
    std::copy_n(speed_bias + 3, 6, next_speed_bias + 3);
  }
  return Status::Ok();
}

}  // namespace inceres
