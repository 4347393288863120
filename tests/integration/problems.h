#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <ceres/problem.h>

#include "inceres/io/bal.h"
#include "tools/problems/bal_ceres_problem.h"
#include "tools/problems/loss_spec.h"

namespace inceres::test {

/// A ceres::Problem with the memory of its parameter blocks: all of them lie in `x`, so that
/// copying `x` captures or restores the state of the whole problem.
struct Instance {
  std::vector<double> x;
  std::unique_ptr<ceres::Problem> problem;
  /// the blocks of the first group of an explicit ordering; may be empty
  std::vector<double*> landmarks;
};

/// Makes the same problem again, each time in memory of its own. Null, with a test failure or a
/// skip recorded, if the data cannot be had.
using Factory = std::function<std::unique_ptr<Instance>(const tools::LossSpec& loss)>;

/// The loss most problems are robustified with.
inline tools::LossSpec Huber(double scale) {
  return {tools::LossSpec::Kind::kHuber, scale};
}

/// A simulated street of eight cameras and 320 points, four observations a point. Start values are
/// `start_noise` times as far off as StreetSceneOptions has them, but those of the first two
/// cameras, which are true.
BalProblem SmallStreet(unsigned seed, double start_noise);

/// A BAL file of bal_data/; a test failure if it cannot be read.
BalProblem BundledBal(const std::string& name);

/// What holds the seven freedoms of a reconstruction without a reference. Levenberg-Marquardt damps
/// them; the Gauss-Newton step of Dog-Leg goes along them as far as rounding takes it.
enum class Gauge { kFree, kTwoCamerasConstant };

/// Cameras of nine tangent parameters and landmarks of size 3, as tools/common builds them.
std::unique_ptr<Instance> MakeBal(const BalProblem& bal, tools::BalCameraModel model, Gauge gauge,
                                  const tools::LossSpec& loss);

/// Angle-axis cameras and homogeneous points X of size 4, Euclidean: the factors 10 (‖X‖² − 1) hold
/// their length.
std::unique_ptr<Instance> MakeHomogeneous(const BalProblem& bal, Gauge gauge,
                                          const tools::LossSpec& loss);

/// How the poses of an inverse-depth problem move.
enum class PoseUpdate {
  kManifold,  ///< AutoDiff in the ambient space and a ceres::ProductManifold
  /// Jacobians of the tangent in the first six columns and [I; 0] for the update, as VINS writes it
  kLocalParameterization
};

/// Poses [p, q] (7 → 6) on an arc, landmarks one inverse depth along a known bearing of the first
/// pose that sees it. The first two poses are constant: that fixes the gauge and the scale.
std::unique_ptr<Instance> MakeInverseDepth(PoseUpdate update, const tools::LossSpec& loss);

/// A g2o file as tools/common builds it; no landmarks. Null if the file cannot be read.
std::unique_ptr<Instance> MakePoseGraph(const std::string& path, const tools::LossSpec& loss);

/// Powell's singular function (Powell, 1962), start (3, −1, 0, 1): four blocks of size 1.
std::unique_ptr<Instance> MakePowell(const tools::LossSpec& loss);

/// y = exp(m x + c) through 60 noisy points, every tenth off by far: two blocks of size 1.
std::unique_ptr<Instance> MakeCurveFit(const tools::LossSpec& loss);

}  // namespace inceres::test
