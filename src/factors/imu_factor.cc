#include "inceres/factors/imu_factor.h"

#include <cstddef>
#include <optional>

#include "factors/imu_math.h"
#include "factors/pose_slot.h"
#include "factors/whiten.h"

// The residual between two states of an IMU and its Jacobians (docs/algorithms.md, "IMU
// pre-integration"; Forster et al. 2017, section VI.C):
//     r_R = Log(ΔRᵀ R_iᵀ R_j),
//     r_v = R_iᵀ(v_j − v_i − gΔt) − Δv,
//     r_p = R_iᵀ(p_j − p_i − v_iΔt − ½gΔt²) − Δp,
//     r_b = b_j − b_i,
// with (ΔR, Δv, Δp) corrected to first order for the biases of i. Conventions decide the order of
// rows and columns (ImuLayout), on which side rotations are perturbed, Log or 2 vec(q), and the
// sign.
//
// Kept per factor is U with UᵀU = Σ⁻¹, which costs a 15×15 Cholesky factorization and a triangular
// inverse and changes only when the samples are integrated anew. It does not follow the biases
// within an iteration: the covariance is that of the biases integrated at.

namespace inceres {

using internal::AsVector;
using internal::CorrectedDelta;
using internal::ImuLayout;
using internal::Matrix;
using internal::Matrix3;
using internal::Skew;
using internal::Vector3;

namespace {

using Jacobian6 = Matrix<15, 6>;
using Jacobian9 = Matrix<15, 9>;

bool TurnsOnTheLeft(const ImuConventions& conventions) {
  return conventions.perturbation == ImuConventions::Perturbation::kLeft;
}

}  // namespace

// A measurement and what Evaluate needs of it.
struct ImuFactorFamily::Factor {
  explicit Factor(const ImuPreintegrator& measurement)
      : imu(measurement), layout(internal::LayoutOf(measurement.options().conventions)) {
    has_information = Weigh();
  }

  // U of what is integrated now, with the conventions' sign; false, and nothing changed, if there
  // is none.
  // The sign is in U and not in the residual: −U whitens as well as U, residual and Jacobians
  // change their sign together, and nothing else needs to know of it.
  bool Weigh() {
    Matrix<15, 15> weight;
    if (!imu.SqrtInformation(weight.data()).ok()) {
      return false;
    }
    const bool flipped =
        imu.options().conventions.sign == ImuConventions::Sign::kMeasuredMinusState;
    U = flipped ? Matrix<15, 15>(-weight) : weight;
    return true;
  }

  ImuPreintegrator imu;
  ImuLayout layout;
  Matrix<15, 15> U;
  bool has_information;
};

namespace {

// The states of a factor, read from its parameters, and the residual before whitening.
struct Comparison {
  Matrix3 R_i, R_j;
  Vector3 way;   // R_iᵀ(p_j − p_i − v_iΔt − ½gΔt²)
  Vector3 gain;  // R_iᵀ(v_j − v_i − gΔt)
  CorrectedDelta delta;
  double q_error[4];  // of the rotation, w ≥ 0, in the frame of j, or of i if perturbed on the left
  Matrix<15, 1> e;
};

// The error's rotation E as a quaternion, and its three residuals from `row` on.
void CompareRotations(const ImuConventions& conventions, const double* q_i, const double* q_j,
                      int row, Comparison* c) {
  double back_i[4], back_delta[4], between[4];
  // R_iᵀ R_j first; ΔRᵀ stands on the left of it where rotations are perturbed on the right, and on
  // the right of it where they are perturbed on the left. So in both cases φ_j acts at the outer
  // end of E.
  ConjugateQuaternion(q_i, back_i);
  ConjugateQuaternion(c->delta.q, back_delta);
  MultiplyQuaternions(back_i, q_j, between);
  if (TurnsOnTheLeft(conventions)) {
    MultiplyQuaternions(between, back_delta, c->q_error);
  } else {
    MultiplyQuaternions(back_delta, between, c->q_error);
  }
  // q and −q are one rotation, but 2 vec(q) tells them apart: with w ≥ 0 it points along the
  // rotation vector of an angle of at most π.
  if (c->q_error[3] < 0.0) {
    for (double& entry : c->q_error) {
      entry = -entry;
    }
  }
  if (conventions.rotation_residual == ImuConventions::RotationResidual::kLog) {
    LogQuaternion(c->q_error, c->e.data() + row);
  } else {
    c->e.segment<3>(row) = 2.0 * AsVector(c->q_error);
  }
}

// `jacobians` is false for a cost-only evaluation, which leaves out the derivative of the
// correction.
void Compare(const ImuPreintegrator& imu, const ImuLayout& layout, const double* const* x,
             bool jacobians, Comparison* c) {
  const ImuConventions& conventions = imu.options().conventions;
  const Vector3 g = AsVector(conventions.gravity);
  const double dt = imu.delta().dt;
  c->R_i = internal::RotationOf(x[0] + 3);
  c->R_j = internal::RotationOf(x[2] + 3);
  // Corrected for the biases of i alone: b_j enters only through the walk.
  c->delta =
      internal::Correct(imu.delta(), x[1] + layout.gyr_column, x[1] + layout.acc_column, jacobians);
  c->way = c->R_i.transpose() *
           (AsVector(x[2]) - AsVector(x[0]) - dt * AsVector(x[1]) - 0.5 * dt * dt * g);
  c->gain = c->R_i.transpose() * (AsVector(x[3]) - AsVector(x[1]) - dt * g);
  CompareRotations(conventions, x[0] + 3, x[2] + 3, layout.rotation, c);
  c->e.segment<3>(layout.position) = c->way - c->delta.p;
  c->e.segment<3>(layout.velocity) = c->gain - c->delta.v;
  // The walk of the biases: their difference, with the integrated walk as covariance.
  c->e.segment<3>(layout.gyr_bias) =
      AsVector(x[3] + layout.gyr_column) - AsVector(x[1] + layout.gyr_column);
  c->e.segment<3>(layout.acc_bias) =
      AsVector(x[3] + layout.acc_column) - AsVector(x[1] + layout.acc_column);
}

// How the rotation residual answers to E Exp(φ), from the right, and to Exp(φ) E: for Log the
// inverse Jacobians; for 2 vec(q) the derivative of 2 vec(q ⊗ Exp(φ)) = 2 vec(q) + (w I + [vec q]×)
// φ.
struct RotationResponse {
  Matrix3 from_right, from_left;
};

RotationResponse Respond(const ImuConventions& conventions, const Comparison& c, int row) {
  RotationResponse response;
  if (conventions.rotation_residual == ImuConventions::RotationResidual::kLog) {
    const Vector3 e = c.e.segment<3>(row);
    const double k = InverseLeftJacobianCoefficient(e.data());
    RotationPolynomial(e.data(), 0.5, k, response.from_right.data());
    RotationPolynomial(e.data(), -0.5, k, response.from_left.data());
  } else {
    const Matrix3 cross = Skew(AsVector(c.q_error));
    response.from_right = c.q_error[3] * Matrix3::Identity() + cross;
    response.from_left = c.q_error[3] * Matrix3::Identity() - cross;
  }
  return response;
}

// The Jacobians before whitening, as functions of one comparison. With right perturbations R
// Exp(φ), E = ΔRᵀ R_iᵀ R_j:
//     ∂E/∂φ_j: E Exp(φ_j),       ∂E/∂φ_i: E Exp(−R_jᵀR_i φ_i),   ∂E/∂φ_Δ: Exp(−φ_Δ) E,
//     ∂way/∂φ_i = [way]×,                 ∂gain/∂φ_i = [gain]×.
// With left ones Exp(φ) R, E = R_iᵀ R_j ΔRᵀ:
//     ∂E/∂φ_j: Exp(R_iᵀφ_j) E,   ∂E/∂φ_i: Exp(−R_iᵀφ_i) E,       ∂E/∂φ_Δ: E Exp(−ΔR φ_Δ),
//     and φ on the left is R_iᵀφ on the right: ∂way/∂φ_i = [way]× R_iᵀ, ∂gain/∂φ_i = [gain]× R_iᵀ.
class Derivatives {
 public:
  Derivatives(const ImuPreintegrator& imu, const ImuLayout& layout, const Comparison& comparison)
      : layout_(layout),
        c_(comparison),
        dt_(imu.delta().dt),
        left_(TurnsOnTheLeft(imu.options().conventions)),
        response_(Respond(imu.options().conventions, comparison, layout.rotation)),
        R_i_inv_(comparison.R_i.transpose()) {}

  // How the error answers to each variable, before whitening. What is not written is zero.
  Jacobian6 ByPoseI() const {
    Jacobian6 E = Jacobian6::Zero();
    const Matrix3 to_i = left_ ? R_i_inv_ : Matrix3(Matrix3::Identity());
    E.block<3, 3>(layout_.position, 0) = -R_i_inv_;
    E.block<3, 3>(layout_.position, 3) = Skew(c_.way) * to_i;
    E.block<3, 3>(layout_.velocity, 3) = Skew(c_.gain) * to_i;
    // On the right φ_i has to be carried through R_iᵀ R_j to the right end of E; on the left it
    // stands at the left end already.
    E.block<3, 3>(layout_.rotation, 3) =
        left_ ? Matrix3(-response_.from_left * R_i_inv_)
              : Matrix3(-response_.from_right * c_.R_j.transpose() * c_.R_i);
    return E;
  }

  // Velocity enters directly, biases through the corrected motion, and each bias through its own
  // row.
  Jacobian9 BySpeedBiasI() const {
    Jacobian9 E = Jacobian9::Zero();
    E.block<3, 3>(layout_.position, 0) = -dt_ * R_i_inv_;
    E.block<3, 3>(layout_.velocity, 0) = -R_i_inv_;
    E.block<3, 3>(layout_.velocity, layout_.gyr_column) =
        -c_.delta.motion_bias.topLeftCorner<3, 3>();
    E.block<3, 3>(layout_.velocity, layout_.acc_column) =
        -c_.delta.motion_bias.topRightCorner<3, 3>();
    E.block<3, 3>(layout_.position, layout_.gyr_column) =
        -c_.delta.motion_bias.bottomLeftCorner<3, 3>();
    E.block<3, 3>(layout_.position, layout_.acc_column) =
        -c_.delta.motion_bias.bottomRightCorner<3, 3>();
    // ΔR Exp(φ_Δ): φ_Δ = phi_gyr_bias δb_g moves E from the left (right convention) or, carried
    // through ΔR, from the right (left convention).
    const Matrix3 turned = left_ ? Matrix3(response_.from_right * internal::RotationOf(c_.delta.q))
                                 : response_.from_left;
    E.block<3, 3>(layout_.rotation, layout_.gyr_column) = -turned * c_.delta.phi_gyr_bias;
    E.block<3, 3>(layout_.gyr_bias, layout_.gyr_column) = -Matrix3::Identity();
    E.block<3, 3>(layout_.acc_bias, layout_.acc_column) = -Matrix3::Identity();
    return E;
  }

  Jacobian6 ByPoseJ() const {
    Jacobian6 E = Jacobian6::Zero();
    E.block<3, 3>(layout_.position, 0) = R_i_inv_;
    E.block<3, 3>(layout_.rotation, 3) =
        left_ ? Matrix3(response_.from_left * R_i_inv_) : response_.from_right;
    return E;
  }

  // v_j and b_j do not enter the preintegrated motion.
  Jacobian9 BySpeedBiasJ() const {
    Jacobian9 E = Jacobian9::Zero();
    E.block<3, 3>(layout_.velocity, 0) = R_i_inv_;
    E.block<3, 3>(layout_.gyr_bias, layout_.gyr_column).setIdentity();
    E.block<3, 3>(layout_.acc_bias, layout_.acc_column).setIdentity();
    return E;
  }

 private:
  const ImuLayout& layout_;
  const Comparison& c_;
  double dt_;
  bool left_;
  RotationResponse response_;
  Matrix3 R_i_inv_;
};

}  // namespace

ImuFactorFamily::ImuFactorFamily() : FactorFamily(15, {{7, 6}, {9, 9}, {7, 6}, {9, 9}}) {
}
ImuFactorFamily::~ImuFactorFamily() = default;

void ImuFactorFamily::Place(int index, const Measurement& measurement) {
  if (index < 0 || index > size()) {
    return;  // FactorGraph::Check finds the family too small
  }
  if (index == size()) {
    factors_.emplace_back();
  }
  // A new Factor each time: U is computed here, once, not in Evaluate.
  factors_[static_cast<std::size_t>(index)] = std::make_unique<Factor>(measurement);
}

const ImuPreintegrator& ImuFactorFamily::measurement(int index) const {
  return factors_[static_cast<std::size_t>(index)]->imu;
}

SlotSpace ImuFactorFamily::Space(int s) const {
  if (s % 2 == 1) {
    return SlotSpace::kEuclidean;
  }
  if (factors_.empty()) {
    return SlotSpace::kAny;
  }
  return TurnsOnTheLeft(factors_.front()->imu.options().conventions) ? SlotSpace::kLeftPose
                                                                     : SlotSpace::kPose;
}

// Called between iterations by the solving thread (FactorFamily::Recenter). Samples are integrated
// anew where the first-order correction has become too far; after that the factor is another
// function, and the caller linearizes it anew.
bool ImuFactorFamily::Recenter(int factor, const double* const* parameters) const {
  Factor& f = *factors_[static_cast<std::size_t>(factor)];
  const double* gyr_bias = parameters[1] + f.layout.gyr_column;
  const double* acc_bias = parameters[1] + f.layout.acc_column;
  // Where that is impossible the first-order correction goes on serving.
  if (!f.imu.NeedsReintegration(gyr_bias, acc_bias) ||
      !f.imu.Reintegrate(gyr_bias, acc_bias).ok()) {
    return false;
  }
  f.has_information = f.Weigh();
  return true;
}

EvaluationFailure ImuFactorFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluateEach(batch, [&](int i) -> const char* {
    const Factor& factor = *factors_[static_cast<std::size_t>(i)];
    // Told here and not in Place, so that the factor's index is in the message.
    if (!factor.has_information) {
      return "the preintegration has no information matrix: too few samples, or none";
    }
    Comparison comparison;
    const bool jacobians = batch.jacobians != nullptr;
    Compare(factor.imu, factor.layout, batch.parameters + 4 * static_cast<std::ptrdiff_t>(i),
            jacobians, &comparison);
    std::optional<Derivatives> derivatives;
    if (jacobians) {
      derivatives.emplace(factor.imu, factor.layout, comparison);
    }
    const double* const U = factor.U.data();
    const auto write_slot = [&](int s, const TangentMap& map, const double* x) {
      if (s % 2 == 0) {
        internal::AssertPoseManifold(map, x, TurnsOnTheLeft(factor.imu.options().conventions));
        const Jacobian6 E = s == 0 ? derivatives->ByPoseI() : derivatives->ByPoseJ();
        return internal::WriteSlot<15, 6>(batch, i, s, U, E.data());
      }
      const Jacobian9 E = s == 1 ? derivatives->BySpeedBiasI() : derivatives->BySpeedBiasJ();
      return internal::WriteSlot<15, 9>(batch, i, s, U, E.data());
    };
    return internal::WriteFactor<15>(batch, i, 4, U, comparison.e.data(), write_slot);
  });
}

}  // namespace inceres
