#include <algorithm>

#include "factors/imu_math.h"
#include "inceres/factors/imu_preintegrator.h"
#include "problem/find_fault.h"

// A state carried on by a preintegrated motion, the inverse of the factor: R_j = R_i ΔR, v_j = v_i
// + gΔt + R_i Δv, p_j = p_i + v_iΔt + ½gΔt² + R_i Δp, and P_j = F P_i Fᵀ + G Σ Gᵀ. The same
// corrected motion as in the factor, so that the factor between the two states has no residual.
// Covariances are carried in the parts' own order and side, and C at both ends takes them to those
// of the conventions.

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
// Rotation: ΔR carries φ_i into the frame of j, and the error of ΔR is in that frame already, as is
// the change of ΔR with b_g. Velocity and position: R_i Exp(φ) Δv ≈ R_i Δv − R_i [Δv]× φ.
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
  // p_j has v_iΔt; velocities are in the world, so no rotation is in between.
  F->block<3, 3>(kDeltaP, kDeltaV) = dt * Matrix3::Identity();
  F->block<3, 3>(kDeltaPhi, kDeltaGyrBias) = delta.phi_gyr_bias;
  // Velocity and position follow the biases through the preintegrated motion, turned into the
  // world.
  F->block<6, 6>(kDeltaV, kDeltaGyrBias) = G->block<6, 6>(kDeltaV, kDeltaV) * delta.motion_bias;
}

// P_j = F P_i Fᵀ + G Σ Gᵀ, where the state turns from R_i to q_j.
void PropagateCovariance(const ImuPreintegrator& imu, const CorrectedDelta& delta,
                         const Matrix3& R_i, const double* q_j, const double* covariance,
                         double* next_covariance) {
  const ImuConventions& conventions = imu.options().conventions;
  const ImuLayout rows = internal::StateLayoutOf(conventions);
  Matrix<15, 15> F, G;
  Linearize(delta, R_i, imu.delta().dt, &F, &G);
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
  // Rounding leaves products a little asymmetric, and a chain of propagations would let that grow.
  Eigen::Map<Matrix<15, 15>>{next_covariance} = 0.5 * (P_j + P_j.transpose());
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
  // Read before anything is written: outputs may be the inputs.
  double q_j[4];
  MultiplyQuaternions(pose + 3, delta.q, q_j);

  if (covariance != nullptr && next_covariance != nullptr) {
    PropagateCovariance(imu, delta, R_i, q_j, covariance, next_covariance);
  }

  const Vector3 v_i = AsVector(speed_bias);
  const Vector3 p_j = AsVector(pose) + dt * v_i + 0.5 * dt * dt * g + R_i * delta.p;
  const Vector3 v_j = v_i + dt * g + R_i * delta.v;
  std::copy_n(p_j.data(), 3, next_pose);
  std::copy_n(q_j, 4, next_pose + 3);
  std::copy_n(v_j.data(), 3, next_speed_bias);
  // Biases stay, in the order in which the variable has them; only their covariance grows.
  if (next_speed_bias != speed_bias) {
    std::copy_n(speed_bias + 3, 6, next_speed_bias + 3);
  }
  return Status::Ok();
}

}  // namespace inceres
