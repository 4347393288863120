#pragma once

#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "common/frame.h"

namespace sliding_window {

/// Continuous-time noise densities of an IMU.
struct ImuNoise {
  double acc = 2e-3;            // m/s^2/sqrt(Hz)
  double gyr = 1.7e-4;          // rad/s/sqrt(Hz)
  double acc_bias_walk = 3e-3;  // m/s^3/sqrt(Hz)
  double gyr_bias_walk = 2e-5;  // rad/s^2/sqrt(Hz)
};

/// The IMU samples between two frames i and j as one relative motion, whatever the state of frame i
/// is:
///
///     p_j = p_i + v_i dt - g dt^2 / 2 + R_i delta_p
///     v_j = v_i - g dt + R_i delta_v
///     q_j = q_i delta_q
///
/// integrated by the mid-point rule at fixed biases, with its covariance and its derivative with
/// respect to the biases. Errors are ordered p, theta (delta_q Exp(theta)), v, ba, bg. Source:
/// Forster et al., On-Manifold Preintegration (T-RO 2017); Qin et al., VINS-Mono (T-RO 2018),
/// section IV.B.
class ImuPreintegration {
 public:
  static constexpr int kP = 0, kTheta = 3, kV = 6, kBa = 9, kBg = 12, kSize = 15;
  using Vector15 = Eigen::Matrix<double, kSize, 1>;
  using Matrix15 = Eigen::Matrix<double, kSize, kSize>;

  /// At least two samples, times increasing.
  ImuPreintegration(const ImuNoise& noise, const std::vector<ImuSample>& samples,
                    const Eigen::Vector3d& ba, const Eigen::Vector3d& bg);

  /// Goes on with the samples after the last one; the first of `samples` repeats it.
  void Append(const std::vector<ImuSample>& samples);
  /// Integrates all samples again at other biases.
  void Repropagate(const Eigen::Vector3d& ba, const Eigen::Vector3d& bg);

  double dt() const { return samples_.back().time - samples_.front().time; }
  const std::vector<ImuSample>& samples() const { return samples_; }
  const Eigen::Vector3d& delta_p() const { return delta_p_; }
  const Eigen::Quaterniond& delta_q() const { return delta_q_; }
  const Eigen::Vector3d& delta_v() const { return delta_v_; }
  const Eigen::Vector3d& ba() const { return ba_; }
  const Eigen::Vector3d& bg() const { return bg_; }
  /// d(error at j) / d(error at i): its columns kBa and kBg are the derivatives with respect to the
  /// biases.
  const Matrix15& jacobian() const { return jacobian_; }
  const Matrix15& covariance() const { return covariance_; }
  /// W with W^T W = covariance^-1.
  const Matrix15& sqrt_information() const { return sqrt_information_; }

 private:
  void Reset(const Eigen::Vector3d& ba, const Eigen::Vector3d& bg);
  void Step(const ImuSample& from, const ImuSample& to);
  void UpdateSqrtInformation();

  ImuNoise noise_;
  std::vector<ImuSample> samples_;
  Eigen::Vector3d ba_, bg_, delta_p_, delta_v_;
  Eigen::Quaterniond delta_q_;
  Matrix15 jacobian_, covariance_, sqrt_information_;
};

}  // namespace sliding_window
