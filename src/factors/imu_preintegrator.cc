#include "inceres/factors/imu_preintegrator.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>

#include <Eigen/Cholesky>

#include "factors/imu_math.h"
#include "problem/find_fault.h"

// The samples of an interval as one relative motion (docs/algorithms.md, "IMU pre-integration").
// Here are the loops over samples, the checks and the information matrix; a single step is in
// imu_step.cc. All samples are kept: the integration is repeated at other biases when the
// first-order correction no longer serves, and goes on when the frame after it leaves a window.
//
// Every call works on a copy of the result and keeps it only if everything in it is finite, so an
// error changes nothing. Integration runs over samples in their order, on one thread: it has the
// same bits whenever it is repeated at the same biases.

namespace inceres {

using internal::AllFinite;
using internal::AsVector;
using internal::Invalid;
using internal::Matrix;
using internal::Matrix3;

namespace {

// The share of its diagonal entry below which a pivot of the covariance counts as nothing, which
// rounding makes 1e-15 or so. Of an integrated random walk, which positions are of velocities, a
// quarter is left.
constexpr double kSingular = 1e-13;

// All finite, times increasing; `before` is the sample they follow, or null.
Status CheckSamples(const std::vector<ImuSample>& samples, const ImuSample* before) {
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const ImuSample& sample = samples[k];
    const std::string name =
        "IMU sample " + std::to_string(k) + " of " + std::to_string(samples.size());
    if (!std::isfinite(sample.time) || !AllFinite(sample.gyr, 3) || !AllFinite(sample.acc, 3)) {
      return Invalid(name + " (time " + std::to_string(sample.time) + ") is not finite");
    }
    if (before != nullptr && !(sample.time > before->time)) {
      return Invalid(name + " has time " + std::to_string(sample.time) +
                     ", which is not after the one before it, " + std::to_string(before->time));
    }
    before = &sample;
  }
  return Status::Ok();
}

Status CheckBiases(const double* gyr_bias, const double* acc_bias) {
  if (!AllFinite(gyr_bias, 3)) {
    return Invalid("the gyroscope bias to integrate at is not finite");
  }
  return AllFinite(acc_bias, 3) ? Status::Ok()
                                : Invalid("the accelerometer bias to integrate at is not finite");
}

// From `delta` on, one step per pair of neighbors. With `before` null the first sample only begins.
Status StepAll(const ImuOptions& options, ImuDelta delta, const ImuSample* before,
               const std::vector<ImuSample>& samples, ImuDelta* result) {
  for (const ImuSample& sample : samples) {
    if (before != nullptr) {
      internal::StepImu(options, *before, sample, &delta);
    }
    before = &sample;
  }
  // Samples are finite one by one, and yet products of them may overflow.
  if (!(AllFinite(delta.q, 4) && AllFinite(delta.v, 3) && AllFinite(delta.p, 3) &&
        AllFinite(delta.bias_jacobian, 54) && AllFinite(delta.covariance, 225))) {
    return Status::Error(StatusCode::kEvaluationFailed,
                         "IMU preintegration overflows: rates, forces or time steps are beyond any "
                         "sensor's");
  }
  *result = delta;
  return Status::Ok();
}

// No motion yet, at these biases: q is the identity and covariance and derivative are zero.
ImuDelta StartAt(const double* gyr_bias, const double* acc_bias) {
  ImuDelta delta;
  std::copy_n(gyr_bias, 3, delta.gyr_bias);
  std::copy_n(acc_bias, 3, delta.acc_bias);
  return delta;
}

}  // namespace

Status ImuPreintegrator::Integrate(const std::vector<ImuSample>& samples, const double gyr_bias[3],
                                   const double acc_bias[3]) {
  // In this order: what is wrong with options shows first.
  for (const Status& status :
       {options_.Validate(), CheckBiases(gyr_bias, acc_bias), CheckSamples(samples, nullptr)}) {
    if (!status.ok()) {
      return status;
    }
  }
  if (samples.size() < 2) {
    return Invalid("IMU preintegration needs two samples at least, one at either end, and got " +
                   std::to_string(samples.size()));
  }
  ImuDelta delta;
  Status status = StepAll(options_, StartAt(gyr_bias, acc_bias), nullptr, samples, &delta);
  if (status.ok()) {
    samples_ = samples;  // may throw: before anything has changed
    delta_ = delta;
  }
  return status;
}

Status ImuPreintegrator::Append(const std::vector<ImuSample>& samples) {
  if (samples_.empty()) {
    return Invalid("Append goes on with what Integrate began, and nothing was integrated yet");
  }
  // Times go on from the last sample that is kept.
  Status status = CheckSamples(samples, &samples_.back());
  if (!status.ok()) {
    return status;
  }
  // The new samples are integrated at the biases of the old ones, whatever the state says now: one
  // preintegration has one pair of biases.
  ImuDelta delta;
  status = StepAll(options_, delta_, &samples_.back(), samples, &delta);
  if (status.ok()) {
    samples_.insert(samples_.end(), samples.begin(), samples.end());
    delta_ = delta;
  }
  return status;
}

Status ImuPreintegrator::Reintegrate(const double gyr_bias[3], const double acc_bias[3]) {
  if (samples_.empty()) {
    return Invalid("Reintegrate repeats what Integrate began, and nothing was integrated yet");
  }
  // The samples were checked when they came in; only the biases are new.
  const Status status = CheckBiases(gyr_bias, acc_bias);
  return status.ok() ? StepAll(options_, StartAt(gyr_bias, acc_bias), nullptr, samples_, &delta_)
                     : status;
}

// Not the biases' change but what it moves is compared, a rotation in rad and a speed in m/s: a
// long interval is integrated anew earlier. NaN compares as false, and the factor's residual then
// says so.
bool ImuPreintegrator::NeedsReintegration(const double gyr_bias[3],
                                          const double acc_bias[3]) const {
  const double rotation = (AsVector(gyr_bias) - AsVector(delta_.gyr_bias)).norm() * delta_.dt;
  const double speed = (AsVector(acc_bias) - AsVector(delta_.acc_bias)).norm() * delta_.dt;
  return rotation > options_.max_rotation_change || speed > options_.max_speed_change;
}

void ImuPreintegrator::ResidualCovariance(double covariance[225]) const {
  // On the left the rotation's error stands in the first frame: Exp(ΔR φ) ΔR = ΔR Exp(φ).
  const bool left = options_.conventions.perturbation == ImuConventions::Perturbation::kLeft;
  const Matrix3 turn = left ? internal::RotationOf(delta_.q) : Matrix3(Matrix3::Identity());
  const Matrix<15, 15> C = internal::PartMap(internal::LayoutOf(options_.conventions), turn);
  const Eigen::Map<const Matrix<15, 15>> canonical(delta_.covariance);
  // Covariances are symmetric, so C Σ Cᵀ needs no inverse of C.
  Eigen::Map<Matrix<15, 15>>{covariance} = C * canonical * C.transpose();
}

// With Σ = M Mᵀ and M upper triangular, U = M⁻¹: the inverse of Σ is never formed. M is the
// Cholesky factor of Σ with its rows and columns in reverse.
Status ImuPreintegrator::SqrtInformation(double U[225]) const {
  Matrix<15, 15> covariance;
  ResidualCovariance(covariance.data());
  const Eigen::LLT<Matrix<15, 15>> factor(covariance.reverse());
  const Matrix<15, 15> L = factor.matrixL();
  // A factorization of a singular matrix may succeed by rounding: pivots are compared with their
  // diagonal entries, which makes the test independent of the units of each row.
  bool regular = factor.info() == Eigen::Success;
  for (int k = 0; k < 15 && regular; ++k) {
    regular = L(k, k) * L(k, k) > kSingular * covariance(14 - k, 14 - k);
  }
  if (!regular) {
    return Status::Error(
        StatusCode::kSingular,
        samples_.empty()
            ? "the IMU preintegration has no information matrix: nothing was integrated"
            : "the IMU preintegration of " + std::to_string(samples_.size()) +
                  " samples has no information matrix: too few samples");
  }
  // L⁻¹ is lower triangular; reversed, it is U = M⁻¹, upper triangular.
  const Matrix<15, 15> inverse = L.triangularView<Eigen::Lower>().solve(Matrix<15, 15>::Identity());
  Eigen::Map<Matrix<15, 15>>{U} = inverse.reverse();
  return Status::Ok();
}

// A cut at both times, so that the motion begins and ends where the states are. Linear
// interpolation is what the midpoint rule assumes between samples, too.
Status InterpolateImuSamples(const std::vector<ImuSample>& samples, double begin, double end,
                             std::vector<ImuSample>* cut) {
  const Status status = CheckSamples(samples, nullptr);
  if (!status.ok()) {
    return status;
  }
  if (!(begin < end)) {
    return Invalid("the interval to cut IMU samples to, from " + std::to_string(begin) + " to " +
                   std::to_string(end) + ", is empty");
  }
  if (samples.empty() || samples.front().time > begin || samples.back().time < end) {
    return Invalid("IMU samples do not reach from " + std::to_string(begin) + " to " +
                   std::to_string(end) + ": " +
                   (samples.empty() ? "there are none"
                                    : "they begin at " + std::to_string(samples.front().time) +
                                          " and end at " + std::to_string(samples.back().time)));
  }
  const auto at = [&samples](double time) {
    // The first sample not before `time`. There is one, and one before it unless it is met exactly,
    // since the samples reach over both ends.
    const auto next =
        std::lower_bound(samples.begin(), samples.end(), time,
                         [](const ImuSample& sample, double t) { return sample.time < t; });
    if (next->time == time) {
      return *next;
    }
    const ImuSample& before = *(next - 1);
    const double share = (time - before.time) / (next->time - before.time);
    ImuSample between;
    between.time = time;
    for (int k = 0; k < 3; ++k) {
      between.gyr[k] = before.gyr[k] + share * (next->gyr[k] - before.gyr[k]);
      between.acc[k] = before.acc[k] + share * (next->acc[k] - before.acc[k]);
    }
    return between;
  };
  // Strictly inside: the ends are there already, whether measured or interpolated.
  std::vector<ImuSample> result{at(begin)};
  std::copy_if(
      samples.begin(), samples.end(), std::back_inserter(result),
      [begin, end](const ImuSample& sample) { return sample.time > begin && sample.time < end; });
  result.push_back(at(end));
  // Last, so that an error leaves `cut` untouched; it may be the vector given as input.
  cut->swap(result);
  return Status::Ok();
}

}  // namespace inceres
