#include <cmath>
#include <utility>

#include "factors/imu_math.h"

// One interval between two samples (docs/algorithms.md, "IMU pre-integration"; Forster et al. 2017,
// midpoint: Qin, Li & Shen 2018, section IV.B). The step is linearized as it is computed, in
// discrete time: derivative and covariance belong to exactly the motion that was integrated, not to
// a differential equation of which it is an approximation. So the derivative by the biases agrees
// with finite differences of the integration itself.
//
// Errors are (φ, δv, δp) with ΔR Exp(φ). Noise and bias enter a sample alike, with opposite signs:
// one matrix B serves for both.

namespace inceres::internal {
namespace {

using Integration = ImuConventions::Integration;

// Of one discrete step, to first order, e the error of (ΔR, Δv, Δp) and n what is added to a
// sample's rate and force:
//     e' = A e + (B_from + B_to) δb − B_from n_from − B_to n_to
struct Linearized {
  Matrix<9, 9> A;
  Matrix<9, 6> B_from;
  Matrix<9, 6> B_to;
};

// The mean force over the interval, in the first frame: how it moves with φ, b_g and with the
// accelerometer at either end.
struct ForceDerivative {
  Matrix3 phi, gyr_bias, acc_from, acc_to;
};

// Normalized each time: rounding would otherwise let the length drift over thousands of samples.
void Turn(const Vector3& turn, double q[4]) {
  double step[4], turned[4];
  ExpQuaternion(turn.data(), step);
  MultiplyQuaternions(q, step, turned);
  const double norm = std::sqrt(turned[0] * turned[0] + turned[1] * turned[1] +
                                turned[2] * turned[2] + turned[3] * turned[3]);
  for (int k = 0; k < 4; ++k) {
    q[k] = turned[k] / norm;
  }
}

// Rows of v and p follow the mean force a: Δv' = Δv + aΔt, Δp' = Δp + ΔvΔt + ½aΔt².
// Rate and force of a sample are columns 0 to 2 and 3 to 5 of B. With the midpoint rule both
// samples have their share; with Euler the later one has none.
Linearized Assemble(const Matrix3& phi_phi, const Matrix3& phi_gyr_bias, const ForceDerivative& a,
                    double dt, bool midpoint) {
  Linearized step;
  step.A.setIdentity();
  step.A.block<3, 3>(kDeltaPhi, kDeltaPhi) = phi_phi;
  step.A.block<3, 3>(kDeltaP, kDeltaV) = dt * Matrix3::Identity();
  Matrix<9, 3> by_gyr;
  by_gyr.block<3, 3>(kDeltaPhi, 0) = phi_gyr_bias;
  step.B_from.setZero();
  step.B_to.setZero();
  // v and p follow a alike, up to the factor: Δt and ½Δt².
  for (const auto& [row, factor] : {std::pair(kDeltaV, dt), std::pair(kDeltaP, 0.5 * dt * dt)}) {
    step.A.block<3, 3>(row, kDeltaPhi) = factor * a.phi;
    by_gyr.block<3, 3>(row, 0) = factor * a.gyr_bias;
    step.B_from.block<3, 3>(row, 3) = factor * a.acc_from;
    step.B_to.block<3, 3>(row, 3) = factor * a.acc_to;
  }
  // The rate is the mean of both ends: each has half of its effect.
  step.B_from.leftCols<3>() = (midpoint ? 0.5 : 1.0) * by_gyr;
  step.B_to.leftCols<3>() = (midpoint ? 0.5 : 0.0) * by_gyr;
  return step;
}

// Moves ΔR, Δv, Δp, and says how.
Linearized Move(bool midpoint, const ImuSample& from, const ImuSample& to, ImuDelta* delta) {
  const double dt = to.time - from.time;
  // Corrected for the bias at which this is integrated, which stays the same over all steps.
  const Vector3 force_from = AsVector(from.acc) - AsVector(delta->acc_bias);
  const Vector3 force_to = AsVector(to.acc) - AsVector(delta->acc_bias);
  const Vector3 rate = midpoint ? Vector3(0.5 * (AsVector(from.gyr) + AsVector(to.gyr)))
                                : Vector3(AsVector(from.gyr));
  const Vector3 turn = dt * (rate - AsVector(delta->gyr_bias));

  const Matrix3 R_from = RotationOf(delta->q);
  Turn(turn, delta->q);
  // ΔR Exp(turn): the bias moves turn by −Δt, and J_r takes that to the right end.
  const Matrix3 phi_gyr_bias = -dt * RightJacobian(turn);
  // φ at the start is carried through the turn: Exp(φ) Exp(turn) = Exp(turn) Exp(Exp(−turn) φ).
  // Sine and cosine do not depend on the sign of turn, only the vector does.
  Matrix3 phi_phi;
  const Vector3 back = -turn;
  const RotationCoefficients k = CoefficientsOfAngle(back.squaredNorm());
  RotationPolynomial(back.data(), k.sinc, k.cosc, phi_phi.data());

  Vector3 a = R_from * force_from;
  // a = R (ã − b): by φ it is −R [force]×, by the accelerometer's bias −R.
  ForceDerivative derivative{-R_from * Skew(force_from), Matrix3::Zero(), -R_from, Matrix3::Zero()};
  if (midpoint) {
    const Matrix3 R_to = RotationOf(delta->q);
    // The force at the end is turned by the rotation at the end, which depends on φ and b_g through
    // the turn of this step.
    const Matrix3 by_phi_to = -0.5 * R_to * Skew(force_to);
    a = 0.5 * (a + R_to * force_to);
    derivative.phi = 0.5 * derivative.phi + by_phi_to * phi_phi;
    derivative.gyr_bias = by_phi_to * phi_gyr_bias;
    derivative.acc_from *= 0.5;
    derivative.acc_to = -0.5 * R_to;
  }
  Eigen::Map<Vector3> v(delta->v), p(delta->p);
  // p before v: the position takes the velocity at the start of the interval.
  p += dt * v + 0.5 * dt * dt * a;
  v += dt * a;
  delta->dt += dt;
  return Assemble(phi_phi, phi_gyr_bias, derivative, dt, midpoint);
}

// σ² of the rate's and of the force's noise, three each.
// `factor` is 1/Δt for a density and 1 for samples; walks take Δt or Δt².
Matrix<6, 1> Variances(double gyr, double acc, double factor) {
  Matrix<6, 1> variances;
  variances << Vector3::Constant(gyr * gyr * factor), Vector3::Constant(acc * acc * factor);
  return variances;
}

void AddNoise(const Matrix<9, 6>& B, const Matrix<6, 1>& variances, Matrix<9, 9>* covariance) {
  const Matrix<9, 6> weighted = B * variances.asDiagonal();
  *covariance += weighted.lazyProduct(B.transpose());
}

// Σ' = F Σ Fᵀ + noise, where F = [A B; 0 I] if the biases walk along, and [A 0; 0 I] if not.
void PropagateCovariance(const ImuOptions& options, const Linearized& step, double dt,
                         ImuDelta* delta) {
  const ImuNoise& noise = options.noise;
  const bool continuous = options.conventions.noise == ImuConventions::Noise::kContinuous;
  const Matrix<9, 6> B = step.B_from + step.B_to;
  // The first nine rows of F; the biases' own rows are [0 I] and need no product.
  Matrix<9, 15> F = Matrix<9, 15>::Zero();
  F.leftCols<9>() = step.A;
  if (options.conventions.bias_walks_while_integrating) {
    F.rightCols<6>() = B;
  }
  Eigen::Map<Matrix<15, 15>> covariance(delta->covariance);
  // Lazy products: Eigen's blocked one packs its operands, which costs more than it brings at this
  // size.
  const Matrix<9, 15> moved = F.lazyProduct(covariance);
  Matrix<9, 9> motion = moved.lazyProduct(F.transpose());
  // A density: one noise over the whole interval, rate and force constant in it, so both ends move
  // as one and B_from + B_to is what counts.
  if (continuous) {
    AddNoise(B, Variances(noise.gyr, noise.acc, 1.0 / dt), &motion);
    // White noise integrated twice has a variance of σ²Δt³/3 in the position, of which ½aΔt² with a
    // constant mean a accounts for σ²Δt³/4. The rest, σ²Δt³/12, is not correlated with the
    // velocity.
    motion.diagonal().tail<3>().array() += noise.acc * noise.acc * dt * dt * dt / 12.0;
  } else {
    const Matrix<6, 1> variances = Variances(noise.gyr, noise.acc, 1.0);
    // Two independent samples, one at each end, as VINS has it.
    AddNoise(step.B_from, variances, &motion);
    AddNoise(step.B_to, variances, &motion);
  }
  // Symmetric to the last bit, whatever the order of the products.
  covariance.topLeftCorner<9, 9>() = 0.5 * (motion + motion.transpose());
  // Covariance of motion and biases: F Σ with the biases' rows of F being [0 I].
  covariance.topRightCorner<9, 6>() = moved.rightCols<6>();
  covariance.bottomLeftCorner<6, 9>() = moved.rightCols<6>().transpose();
  covariance.bottomRightCorner<6, 6>().diagonal() +=
      Variances(noise.gyr_bias_walk, noise.acc_bias_walk, continuous ? dt : dt * dt);
}

}  // namespace

void StepImu(const ImuOptions& options, const ImuSample& from, const ImuSample& to,
             ImuDelta* delta) {
  const bool midpoint = options.conventions.integration == Integration::kMidpoint;
  const Linearized step = Move(midpoint, from, to, delta);
  // J is the sensitivity of the whole motion so far: what came before goes through A, this step
  // adds B.
  Eigen::Map<Matrix<9, 6>> J(delta->bias_jacobian);
  J = (step.A.lazyProduct(J) + step.B_from + step.B_to).eval();
  PropagateCovariance(options, step, to.time - from.time, delta);
}

}  // namespace inceres::internal
