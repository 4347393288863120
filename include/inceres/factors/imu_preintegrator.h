#pragma once

#include <vector>

#include "inceres/export.h"
#include "inceres/problem/manifolds.h"
#include "inceres/status.h"

namespace inceres {

/// What an inertial measurement unit measured at a time: angular rate ω̃ = ω + b_g + n_g and
/// specific force ã = Rᵀ(a − g) + b_a + n_a, both in its own frame.
struct ImuSample {
  double time = 0.0;                ///< seconds
  double gyr[3] = {0.0, 0.0, 0.0};  ///< rad/s
  double acc[3] = {0.0, 0.0, 0.0};  ///< m/s²
};

/// Standard deviations of white noise and of the random walk of the biases; what they are per is
/// ImuConventions::noise.
struct ImuNoise {
  double gyr = 1.7e-4;          ///< > 0; rad/s/√Hz as a density
  double acc = 2e-3;            ///< > 0; m/s²/√Hz
  double gyr_bias_walk = 2e-5;  ///< > 0; rad/s²/√Hz
  double acc_bias_walk = 3e-3;  ///< > 0; m/s³/√Hz
};

/// The parts of an IMU residual.
enum class ImuPart : unsigned char {
  kRotation,  ///< φ
  kPosition,  ///< p
  kVelocity,  ///< v
  kGyrBias,   ///< b_g
  kAccBias,   ///< b_a
};

/// How an estimator writes its inertial terms. None of it changes what is estimated, but for the
/// noise; all of it changes what the numbers look like, and a user who moves over wants to find his
/// own. The default is that of docs/visual_inertial.md.
struct INCERES_EXPORT ImuConventions {
  /// Which way a small rotation φ perturbs a pose, and so in which frame the rotation residual
  /// stands: kRight Log(ΔRᵀ R_iᵀ R_j), in the frame of j; kLeft Log(R_iᵀ R_j ΔRᵀ), in the frame of
  /// i.
  using Perturbation = inceres::Perturbation;
  /// How the rotation's error becomes three numbers.
  enum class RotationResidual : unsigned char {
    kLog,          ///< the rotation vector
    kTwiceVector,  ///< 2 vec(q), q the quaternion with w ≥ 0: the same to third order, flat at π
  };
  /// Which of the two is subtracted.
  enum class Sign : unsigned char {
    kStateMinusMeasured,  ///< what the states say, minus what was measured
    kMeasuredMinusState,  ///< the other way around
  };
  /// Which bias stands first in the speed-bias variable.
  enum class BiasOrder : unsigned char {
    kGyrFirst,  ///< v, b_g, b_a
    kAccFirst,  ///< v, b_a, b_g
  };
  /// What is assumed between two samples.
  enum class Integration : unsigned char {
    /// mean of the rates at both ends, mean of the forces turned into the first frame: second order
    kMidpoint,
    kEuler,  ///< a sample holds until the next one: first order
  };
  /// What the numbers of ImuNoise mean.
  enum class Noise : unsigned char {
    /// Densities: σ²/Δt for each interval of length Δt, walks σ²Δt. The position gets what white
    /// noise leaves there within an interval, σ_a²Δt³/12, without which one interval alone would
    /// have no information matrix.
    kContinuous,
    /// Of a single sample, whatever the rate: σ² for each sample, walks σ²Δt² for each interval.
    /// With kMidpoint the two ends of an interval count as independent (an 18×18 noise matrix),
    /// though neighbors share a sample.
    kPerSample,
  };

  Perturbation perturbation = Perturbation::kRight;  ///< on which side a pose is perturbed
  RotationResidual rotation_residual = RotationResidual::kLog;  ///< of the rotation's three rows
  Sign sign = Sign::kStateMinusMeasured;                        ///< of all rows
  /// The order of the 15 residuals, three each.
  ImuPart residual_order[5] = {ImuPart::kRotation, ImuPart::kVelocity, ImuPart::kPosition,
                               ImuPart::kGyrBias, ImuPart::kAccBias};
  /// Of the speed-bias variable: velocity, then the biases in this order.
  BiasOrder bias_order = BiasOrder::kGyrFirst;
  double gravity[3] = {0.0, 0.0,
                       -9.81};  ///< g, the acceleration of free fall in the world frame, m/s²
  Integration integration = Integration::kMidpoint;  ///< between two samples
  Noise noise = Noise::kContinuous;                  ///< what the numbers of ImuOptions::noise mean
  /// Whether the biases walk while they are integrated, which correlates them with the motion
  /// (15×15), or only between the two states (9×9 and a diagonal).
  bool bias_walks_while_integrating = true;

  /// As VINS-Mono and VINS-Fusion: p, θ, v, b_a, b_g; v, b_a, b_g; z up; noise per sample. (They
  /// integrate a rotation by a first order quaternion; Exp here.)
  static ImuConventions Vins(double gravity_norm = 9.81);
  /// As OKVIS: p, α, v, b_g, b_a; v, b_g, b_a; perturbed on the left; measured minus state; z up.
  /// (It propagates a covariance that leaves out correlations within an interval.)
  static ImuConventions Okvis(double gravity_norm = 9.81);
  /// As XRSLAM: q, p, v, b_g, b_a; Euler; z up; walks between the states. (Its q, p, v and biases
  /// are variables of their own: here a pose and a speed-bias.)
  static ImuConventions Xrslam(double gravity_norm = 9.80665);

  /// Refuses a residual order with a part twice, and a gravity that is not finite.
  Status Validate() const;
};

/// All that preintegration has to know beside the samples.
struct INCERES_EXPORT ImuOptions {
  ImuNoise noise;              ///< of the samples
  ImuConventions conventions;  ///< of whoever uses the numbers
  /// Samples are integrated anew, by the solver between two iterations, once the biases have moved
  /// so far from those they were integrated at that the rotation ‖δb_g‖Δt (rad) or the speed
  /// ‖δb_a‖Δt (m/s) exceeds these; until then the first-order correction serves, whose error is
  /// quadratic in δb_g. ≥ 0; 0: whenever a bias has moved; infinity: never.
  double max_rotation_change = 1e-4;
  double max_speed_change = 1e-2;  ///< m/s; see max_rotation_change

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

/// What a stretch of IMU samples says about the motion from its first to its last sample, whatever
/// the state at its start; and how it depends on the biases and on noise, to first order. Errors
/// are those of (ΔR, Δv, Δp), ΔR Exp(φ), v + δv, p + δp, whatever the conventions.
struct ImuDelta {
  double dt = 0.0;  ///< seconds
  double q[4] = {
      0.0, 0.0, 0.0,
      1.0};  ///< ΔR as x, y, z, w: turns vectors of the last frame into those of the first
  double v[3] = {0.0, 0.0,
                 0.0};  ///< Δv in the first frame, m/s: without the start's velocity and gravity
  double p[3] = {0.0, 0.0, 0.0};         ///< Δp in the first frame, m
  double gyr_bias[3] = {0.0, 0.0, 0.0};  ///< integrated at these biases
  double acc_bias[3] = {0.0, 0.0, 0.0};  ///< and at these
  double bias_jacobian[9 * 6] = {};      ///< ∂(φ, v, p)/∂(b_g, b_a), row-major
  double covariance[15 * 15] = {};       ///< of (φ, v, p, b_g, b_a), row-major
};

/// Integrates IMU samples into one relative motion with its covariance and its derivative with
/// respect to the biases:
///
///     ΔR ← ΔR Exp((ω̃ − b_g)Δt),   Δv ← Δv + ΔR(ã − b_a)Δt,   Δp ← Δp + ΔvΔt + ½ΔR(ã − b_a)Δt²
///
/// (Euler; with midpoint the means over the interval's ends), and the covariance by F Σ Fᵀ + noise
/// of the same discrete step. It keeps the samples, to go on with more of them or to integrate all
/// again at other biases. It is the measurement of ImuFactorFamily.
///
/// Every call does all or nothing: after an error the object is as it was, and the message names
/// the sample or the option. Cost: about 14,000 instructions a sample (x86-64, SSE2). Threads: as a
/// plain value. Source: Forster, Carlone, Dellaert & Scaramuzza, "On-Manifold Preintegration for
/// Real-Time Visual-Inertial Odometry", 2017, sections VI and VII; midpoint: Qin, Li & Shen,
/// "VINS-Mono", 2018, section IV.B.
class INCERES_EXPORT ImuPreintegrator {
 public:
  /// What is wrong with the options is told by Integrate.
  explicit ImuPreintegrator(const ImuOptions& options = {}) : options_(options) {}

  /// Integrates these samples from scratch at these biases. At least two, all finite, their times
  /// increasing; the first and the last one stand at the times of the two states
  /// (InterpolateImuSamples cuts them so). With Euler the last one's rates do not count.
  Status Integrate(const std::vector<ImuSample>& samples, const double gyr_bias[3],
                   const double acc_bias[3]);

  /// Goes on with samples after the last one.
  Status Append(const std::vector<ImuSample>& samples);

  /// Integrates the samples kept anew at other biases.
  Status Reintegrate(const double gyr_bias[3], const double acc_bias[3]);

  /// Whether these biases are further from those integrated at than the options allow.
  [[nodiscard]] bool NeedsReintegration(const double gyr_bias[3], const double acc_bias[3]) const;

  /// As given to the constructor.
  const ImuOptions& options() const { return options_; }
  /// All samples integrated, kept to integrate them anew.
  const std::vector<ImuSample>& samples() const { return samples_; }
  /// What they say about the motion.
  const ImuDelta& delta() const { return delta_; }

  /// Covariance of the residual, 15×15 row-major, in the order and frame of the conventions. In the
  /// left one it is that of the biases integrated at: a correction turns the rotation's part by an
  /// angle that max_rotation_change keeps small.
  void ResidualCovariance(double covariance[225]) const;
  /// The upper triangular U with UᵀU = covariance⁻¹ of the residual, row-major. An error if there
  /// is none: nothing was integrated, or a single interval with noise per sample, which leaves
  /// position and velocity in line.
  Status SqrtInformation(double U[225]) const;

 private:
  ImuOptions options_;
  std::vector<ImuSample> samples_;
  ImuDelta delta_;
};

/// The samples of [begin, end]: those strictly inside, and one at each border, interpolated
/// linearly where there is none. `samples` must have increasing times and reach from begin to end.
/// On an error, which says what is missing, `cut` is untouched.
INCERES_EXPORT Status InterpolateImuSamples(const std::vector<ImuSample>& samples, double begin,
                                            double end, std::vector<ImuSample>* cut);

/// Where a state goes: plain propagation, with its covariance if both are not null. `pose` is p
/// (3), q (x, y, z, w); `speed_bias` the velocity and the biases in the order of the conventions;
/// `covariance` 15×15, row-major, over (δp, φ) of the pose with φ as the conventions perturb, then
/// the speed-bias. Outputs may be the inputs.
///
///     R_j = R_i ΔR,   v_j = v_i + gΔt + R_i Δv,   p_j = p_i + v_iΔt + ½gΔt² + R_i Δp
///     P_j = F P_i Fᵀ + G Σ Gᵀ
///
/// with Δ corrected to first order for the state's biases, so that the state it gives and the one
/// it came from leave the factor of the same preintegration no residual. Integrate at the state's
/// biases for a correction of zero. An error if nothing was integrated or an input is not finite;
/// outputs are then untouched. Cost: a few 15×15 products; allocates nothing.
INCERES_EXPORT Status PropagateImu(const ImuPreintegrator& imu, const double* pose,
                                   const double* speed_bias, const double* covariance,
                                   double* next_pose, double* next_speed_bias,
                                   double* next_covariance);

}  // namespace inceres
