#pragma once

#include "inceres/export.h"
#include "inceres/factors/perturbation.h"
#include "inceres/status.h"

namespace inceres {

/// What an inertial measurement unit measured at a time: angular rate ω̃ = ω + b_g + n_g and specific force ã = Rᵀ(a − g) + b_a +
/// n_a, both in its own frame.
struct ImuSample {
  double time = 0.0;                ///< seconds
  double gyr[3] = {0.0, 0.0, 0.0};  ///< rad/s
  double acc[3] = {0.0, 0.0, 0.0};  ///< m/s²
};

/// Standard deviations of white noise and of the random walk of the biases; what they are per is ImuConventions::noise.
struct ImuNoise {
  double gyr = 1.7e-4;          ///< > 0; rad/s/√Hz as a density
  double acc = 2e-3;            ///< > 0; m/s²/√Hz
  double gyr_bias_walk = 2e-5;  ///< > 0; rad/s²/√Hz
  double acc_bias_walk = 3e-3;  ///< > 0; m/s³/√Hz
};

/// The parts of an IMU residual.
enum class ImuPart : unsigned char { kRotation, kPosition, kVelocity, kGyrBias, kAccBias };

/// How an estimator writes its inertial terms. None of it changes what is estimated, but for the noise; all of it changes what
/// the numbers look like, and a user who moves over wants to find his own. The default is that of docs/visual_inertial.md.
struct INCERES_EXPORT ImuConventions {
  /// Which way a small rotation φ perturbs a pose, and so in which frame the rotation residual stands: kRight Log(ΔRᵀ R_iᵀ R_j),
  /// in the frame of j; kLeft Log(R_iᵀ R_j ΔRᵀ), in the frame of i.
  using Perturbation = inceres::Perturbation;
  enum class RotationResidual : unsigned char {
    kLog,          ///< the rotation vector
    kTwiceVector,  ///< 2 vec(q), q the quaternion with w ≥ 0: the same to third order, flat at π
  };
  enum class Sign : unsigned char {
    kStateMinusMeasured,  ///< what the states say, minus what was measured
    kMeasuredMinusState,
  };
  enum class BiasOrder : unsigned char { kGyrFirst, kAccFirst };
  enum class Integration : unsigned char {
    kMidpoint,  ///< mean of the rates at both ends, mean of the forces turned into the first frame: second order
    kEuler,     ///< a sample holds until the next one: first order
  };
  enum class Noise : unsigned char {
    /// Densities: σ²/Δt for each interval of length Δt, walks σ²Δt. The position gets what white noise leaves there within an
    /// interval, σ_a²Δt³/12, without which one interval alone would have no information matrix.
    kContinuous,
    /// Of a single sample, whatever the rate: σ² for each sample, walks σ²Δt² for each interval. With kMidpoint the two ends
    /// of an interval count as independent (an 18×18 noise matrix), though neighbors share a sample.
    kPerSample,
  };

  Perturbation perturbation = Perturbation::kRight;
  RotationResidual rotation_residual = RotationResidual::kLog;
  Sign sign = Sign::kStateMinusMeasured;
  /// The order of the 15 residuals, three each.
  ImuPart residual_order[5] = {ImuPart::kRotation, ImuPart::kVelocity, ImuPart::kPosition, ImuPart::kGyrBias, ImuPart::kAccBias};
  /// Of the speed-bias variable: velocity, then the biases in this order.
  BiasOrder bias_order = BiasOrder::kGyrFirst;
  double gravity[3] = {0.0, 0.0, -9.81};  ///< g, the acceleration of free fall in the world frame, m/s²
  Integration integration = Integration::kMidpoint;
  Noise noise = Noise::kContinuous;
  /// Whether the biases walk while they are integrated, which correlates them with the motion (15×15), or only between the two
  /// states (9×9 and a diagonal).
  bool bias_walks_while_integrating = true;

  /// As VINS-Mono and VINS-Fusion: p, θ, v, b_a, b_g; v, b_a, b_g; z up; noise per sample. (They integrate a rotation by a first
  /// order quaternion; Exp here.)
  static ImuConventions Vins(double gravity_norm = 9.81);
  /// As OKVIS: p, α, v, b_g, b_a; v, b_g, b_a; perturbed on the left; measured minus state; z up. (It propagates a covariance
  /// that leaves out correlations within an interval.)
  static ImuConventions Okvis(double gravity_norm = 9.81);
  /// As XRSLAM: q, p, v, b_g, b_a; Euler; z up; walks between the states. (Its q, p, v and biases are variables of their own:
  /// here a pose and a speed-bias.)
  static ImuConventions Xrslam(double gravity_norm = 9.80665);

  /// Refuses a residual order with a part twice, and a gravity that is not finite.
  Status Validate() const;
};

/// All that preintegration has to know beside the samples.
struct INCERES_EXPORT ImuOptions {
  ImuNoise noise;
  ImuConventions conventions;
  /// Samples are integrated anew, by the solver between two iterations, once the biases have moved so far from those they were
  /// integrated at that the rotation ‖δb_g‖Δt (rad) or the speed ‖δb_a‖Δt (m/s) exceeds these; until then the first-order
  /// correction serves, whose error is quadratic in δb_g. ≥ 0; 0: whenever a bias has moved; infinity: never.
  double max_rotation_change = 1e-4;
  double max_speed_change = 1e-2;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

}  // namespace inceres
