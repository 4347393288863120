#pragma once

#include <vector>

#include "inceres/export.h"
#include "inceres/factors/imu_options.h"
#include "inceres/status.h"

namespace inceres {

/// What a stretch of IMU samples says about the motion from its first to its last sample, whatever the state at its start; and
/// how it depends on the biases and on noise, to first order. Errors are those of (ΔR, Δv, Δp), ΔR Exp(φ), v + δv, p + δp,
/// whatever the conventions.
struct ImuDelta {
  double dt = 0.0;                       ///< seconds
  double q[4] = {0.0, 0.0, 0.0, 1.0};    ///< ΔR as x, y, z, w: turns vectors of the last frame into those of the first
  double v[3] = {0.0, 0.0, 0.0};         ///< Δv in the first frame, m/s: without the start's velocity and gravity
  double p[3] = {0.0, 0.0, 0.0};         ///< Δp in the first frame, m
  double gyr_bias[3] = {0.0, 0.0, 0.0};  ///< integrated at these biases
  double acc_bias[3] = {0.0, 0.0, 0.0};
  double bias_jacobian[9 * 6] = {};  ///< ∂(φ, v, p)/∂(b_g, b_a), row-major
  double covariance[15 * 15] = {};   ///< of (φ, v, p, b_g, b_a), row-major
};

/// Integrates IMU samples into one relative motion with its covariance and its derivative with respect to the biases:
///
///     ΔR ← ΔR Exp((ω̃ − b_g)Δt),   Δv ← Δv + ΔR(ã − b_a)Δt,   Δp ← Δp + ΔvΔt + ½ΔR(ã − b_a)Δt²
///
/// (Euler; with midpoint the means over the interval's ends), and the covariance by F Σ Fᵀ + noise of the same discrete step. It
/// keeps the samples, to go on with more of them or to integrate all again at other biases. It is the measurement of
/// ImuFactorFamily.
///
/// Every call does all or nothing: after an error the object is as it was, and the message names the sample or the option.
/// Cost: about 14,000 instructions a sample (x86-64, SSE2). Threads: as a plain value.
/// Source: Forster, Carlone, Dellaert & Scaramuzza, "On-Manifold Preintegration for Real-Time Visual-Inertial Odometry", 2017,
/// sections VI and VII; midpoint: Qin, Li & Shen, "VINS-Mono", 2018, section IV.B.
class INCERES_EXPORT ImuPreintegrator {
 public:
  /// What is wrong with the options is told by Integrate.
  explicit ImuPreintegrator(const ImuOptions& options = {}) : options_(options) {}

  /// Integrates these samples from scratch at these biases. At least two, all finite, their times increasing; the first and the
  /// last one stand at the times of the two states (InterpolateImuSamples cuts them so). With Euler the last one's rates do not
  /// count.
  Status Integrate(const std::vector<ImuSample>& samples, const double gyr_bias[3], const double acc_bias[3]);

  /// Goes on with samples after the last one.
  Status Append(const std::vector<ImuSample>& samples);

  /// Integrates the samples kept anew at other biases.
  Status Reintegrate(const double gyr_bias[3], const double acc_bias[3]);

  /// Whether these biases are further from those integrated at than the options allow.
  [[nodiscard]] bool NeedsReintegration(const double gyr_bias[3], const double acc_bias[3]) const;

  const ImuOptions& options() const { return options_; }
  const std::vector<ImuSample>& samples() const { return samples_; }
  const ImuDelta& delta() const { return delta_; }

  /// Covariance of the residual, 15×15 row-major, in the order and frame of the conventions. In the left one it is that of the
  /// biases integrated at: a correction turns the rotation's part by an angle that max_rotation_change keeps small.
  void ResidualCovariance(double covariance[225]) const;
  /// The upper triangular U with UᵀU = covariance⁻¹ of the residual, row-major. An error if there is none: nothing was
  /// integrated, or a single interval with noise per sample, which leaves position and velocity in line.
  Status SqrtInformation(double U[225]) const;

 private:
  ImuOptions options_;
  std::vector<ImuSample> samples_;
  ImuDelta delta_;
};

/// The samples of [begin, end]: those strictly inside, and one at each border, interpolated linearly where there is none.
/// `samples` must have increasing times and reach from begin to end. On an error, which says what is missing, `cut` is untouched.
INCERES_EXPORT Status InterpolateImuSamples(const std::vector<ImuSample>& samples, double begin, double end,
                                            std::vector<ImuSample>* cut);

/// Where a state goes: plain propagation, with its covariance if both are not null. `pose` is p (3), q (x, y, z, w); `speed_bias`
/// the velocity and the biases in the order of the conventions; `covariance` 15×15, row-major, over (δp, φ) of the pose with φ as
/// the conventions perturb, then the speed-bias. Outputs may be the inputs.
///
///     R_j = R_i ΔR,   v_j = v_i + gΔt + R_i Δv,   p_j = p_i + v_iΔt + ½gΔt² + R_i Δp,   P_j = F P_i Fᵀ + G Σ Gᵀ
///
/// with Δ corrected to first order for the state's biases, so that the state it gives and the one it came from leave the factor
/// of the same preintegration no residual. Integrate at the state's biases for a correction of zero. An error if nothing was
/// integrated or an input is not finite; outputs are then untouched. Cost: a few 15×15 products; allocates nothing.
INCERES_EXPORT Status PropagateImu(const ImuPreintegrator& imu, const double* pose, const double* speed_bias,
                                   const double* covariance, double* next_pose, double* next_speed_bias, double* next_covariance);

}  // namespace inceres
