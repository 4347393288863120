#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "factors/imu_math.h"
#include "inceres/factors/imu_preintegrator.h"
#include "problem/find_fault.h"

// Named conventions and checks of options. A preset only says what differs from the default; each
// choice is one that its program makes, listed in docs/visual_inertial.md ("Conventions").
// Conventions change how states, residuals and noise are written down, not what is measured: a
// program's own values, such as its biases in its order and its noise per sample, can be handed
// over as they are. The checks are made before anything is integrated, since a wrong option would
// only show as a residual that is off.

namespace inceres {

using internal::Invalid;

namespace {

// Gravity points down the z axis in all of them; `gravity_norm` is its magnitude.
// Gravity is the acceleration of free fall: an IMU at rest reads its opposite.
ImuConventions WithOrder(const ImuPart (&order)[5], double gravity_norm) {
  ImuConventions conventions;
  std::copy_n(order, 5, conventions.residual_order);
  conventions.gravity[2] = -gravity_norm;
  return conventions;
}

}  // namespace

// VINS: rotation errors are 2 vec(q), and the noise is that of a sample, not a density.
// Its speed-bias variable has the accelerometer's bias first, and so do its residuals.
ImuConventions ImuConventions::Vins(double gravity_norm) {
  ImuConventions vins = WithOrder({ImuPart::kPosition, ImuPart::kRotation, ImuPart::kVelocity,
                                   ImuPart::kAccBias, ImuPart::kGyrBias},
                                  gravity_norm);
  vins.rotation_residual = RotationResidual::kTwiceVector;
  vins.bias_order = BiasOrder::kAccFirst;
  vins.noise = Noise::kPerSample;
  return vins;
}

// OKVIS perturbs on the left and subtracts the state from the measurement.
// Its noise is a density and its integration by midpoints, which are the defaults.
ImuConventions ImuConventions::Okvis(double gravity_norm) {
  ImuConventions okvis = WithOrder({ImuPart::kPosition, ImuPart::kRotation, ImuPart::kVelocity,
                                    ImuPart::kGyrBias, ImuPart::kAccBias},
                                   gravity_norm);
  okvis.perturbation = Perturbation::kLeft;
  okvis.rotation_residual = RotationResidual::kTwiceVector;
  okvis.sign = Sign::kMeasuredMinusState;
  return okvis;
}

// XRSLAM holds a sample until the next, and lets biases walk between the states only.
// Euler: the sample at the beginning of an interval counts for all of it.
ImuConventions ImuConventions::Xrslam(double gravity_norm) {
  ImuConventions xrslam = WithOrder({ImuPart::kRotation, ImuPart::kPosition, ImuPart::kVelocity,
                                     ImuPart::kGyrBias, ImuPart::kAccBias},
                                    gravity_norm);
  xrslam.integration = Integration::kEuler;
  xrslam.bias_walks_while_integrating = false;
  return xrslam;
}

Status ImuConventions::Validate() const {
  bool seen[5] = {};
  // A part named twice would leave another one without rows, and the residual map singular.
  for (const ImuPart part : residual_order) {
    // Unsigned, so that a value below the first enumerator is too large.
    const auto index = static_cast<unsigned>(part);
    if (index >= 5 || seen[index]) {
      return Invalid("ImuConventions::residual_order must name each of the five parts once");
    }
    seen[index] = true;
  }
  if (!internal::AllFinite(gravity, 3)) {
    return Invalid("ImuConventions::gravity is not finite");
  }
  return Status::Ok();
}

// Comparisons are negated, so that NaN fails. The first culprit is the one named.
Status ImuOptions::Validate() const {
  // The walks too: without them biases would be constant and their residuals have no information
  // matrix.
  const std::pair<const char*, double> deviations[] = {{"gyr", noise.gyr},
                                                       {"acc", noise.acc},
                                                       {"gyr_bias_walk", noise.gyr_bias_walk},
                                                       {"acc_bias_walk", noise.acc_bias_walk}};
  for (const auto& [name, value] : deviations) {
    if (!(value > 0.0) || !std::isfinite(value)) {
      return Invalid("ImuNoise::" + std::string(name) + " = " + std::to_string(value) +
                     " must be positive and finite: without noise there is no information matrix");
    }
  }
  // Infinity is allowed: never. Zero: whenever a bias has moved.
  if (!(max_rotation_change >= 0.0)) {
    return Invalid("ImuOptions::max_rotation_change = " + std::to_string(max_rotation_change) +
                   " must be at least 0");
  }
  if (!(max_speed_change >= 0.0)) {
    return Invalid("ImuOptions::max_speed_change = " + std::to_string(max_speed_change) +
                   " must be at least 0");
  }
  return conventions.Validate();
}

// Where conventions put things. Inside, errors have one order, (φ, v, p, b_g, b_a), and one side,
// the right; PartMap takes them to the rows and the side that a user wants. A convention is thus a
// permutation and a rotation of one block, C, and a covariance goes along as C Σ Cᵀ: the
// integration knows of no convention but those that change numbers (noise, walks, midpoint or
// Euler).

namespace internal {

ImuLayout LayoutOf(const ImuConventions& conventions) {
  ImuLayout layout = {};
  for (int k = 0; k < 5; ++k) {
    // In the order of the enumeration ImuPart, which indexes them.
    int* const places[] = {&layout.rotation, &layout.position, &layout.velocity, &layout.gyr_bias,
                           &layout.acc_bias};
    *places[static_cast<int>(conventions.residual_order[k])] = 3 * k;
  }
  // Velocity is first in every convention; the two biases share columns 3 to 8.
  const bool gyr_first = conventions.bias_order == ImuConventions::BiasOrder::kGyrFirst;
  layout.gyr_column = gyr_first ? 3 : 6;
  layout.acc_column = gyr_first ? 6 : 3;
  return layout;
}

// Of a state: the pose's tangent (δp, φ), then the nine values of the speed-bias as they stand in
// the variable. The order of residuals does not matter here.
ImuLayout StateLayoutOf(const ImuConventions& conventions) {
  ImuLayout layout = LayoutOf(conventions);
  layout.position = 0;
  layout.rotation = 3;
  layout.velocity = 6;
  layout.gyr_bias = 6 + layout.gyr_column;
  layout.acc_bias = 6 + layout.acc_column;
  return layout;
}

Matrix<15, 15> PartMap(const ImuLayout& rows, const Matrix3& R) {
  Matrix<15, 15> C = Matrix<15, 15>::Zero();
  // R is the identity on the right. On the left, Exp(R φ) R = R Exp(φ): the error stands in the
  // other frame.
  C.block<3, 3>(rows.rotation, kDeltaPhi) = R;
  C.block<3, 3>(rows.velocity, kDeltaV).setIdentity();
  C.block<3, 3>(rows.position, kDeltaP).setIdentity();
  C.block<3, 3>(rows.gyr_bias, kDeltaGyrBias).setIdentity();
  C.block<3, 3>(rows.acc_bias, kDeltaAccBias).setIdentity();
  return C;
}

}  // namespace internal
}  // namespace inceres
