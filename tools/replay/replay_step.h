#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/imu_preintegrator.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/relative_pose.h"
#include "tools/problems/loss_spec.h"

namespace inceres::tools {

/// What a problem that arrives step by step is made of, whoever solves it. Variables are numbered
/// 0, 1, 2, … in order of arrival, over all steps; factors name them by that number.
struct ReplayVariable {
  enum class Kind {
    kBalCamera,      ///< 9: rotation vector, translation, f, k1, k2
    kBalCameraPose,  ///< the same with f, k1, k2 held constant
    kPoint,          ///< 3, a landmark
    /// 7 on PoseManifold: place and quaternion x, y, z, w of a camera or a body in the world, or of
    /// a camera on it
    kPose,
    kSpeedBias,     ///< 9: velocity, biases of the gyroscope and the accelerometer
    kInverseDepth,  ///< 1, a landmark
    kPlanarPose,    ///< 3: x, y, angle
  };
  Kind kind = Kind::kPoint;
  std::array<double, 9> start{};  ///< only the first AmbientSize(kind) entries are used
  bool constant = false;
  /// The number of an earlier pose that `start` is seen from: the variable begins at T ∘ start
  /// (poses) or T start (points), where T is what that pose has come to when this variable arrives.
  /// Negative: `start` is seen from the world.
  int start_from = -1;
};

int AmbientSize(ReplayVariable::Kind kind);
int TangentSize(ReplayVariable::Kind kind);
bool IsLandmark(ReplayVariable::Kind kind);

/// The loss of what is measured, not known beforehand, in all replays.
inline constexpr LossSpec kUnitHuber{LossSpec::Kind::kHuber, 1.0};

/// A landmark seen by a camera that many sightings share, of PointReprojectionFamily.
struct PointSighting {
  PixelObservation seen;
  std::shared_ptr<const PinholeCamera> camera;
};

/// The same for a stereo camera, of StereoReprojectionFamily.
struct StereoPointSighting {
  StereoObservation seen;
  std::shared_ptr<const StereoCamera> camera;
};

struct ReplayFactor {
  std::variant<BalReprojectionFamily::Measurement, InverseDepthReprojectionFamily::Measurement,
               RelativePoseFamily::Measurement, DiagonalPriorFamily::Measurement, PointSighting,
               std::shared_ptr<const ImuPreintegrator>, StereoPointSighting,
               PlanarRelativePoseFamily::Measurement>
      measurement;
  std::vector<int> variables;  ///< one per slot of the family
  LossSpec loss;
  /// That it is wrong is possible: a loop of a pose graph. And that it is: one that was added.
  bool is_suspect = false;
  bool is_wrong = false;
};

struct ReplayStep {
  std::vector<ReplayVariable> variables;
  std::vector<ReplayFactor> factors;  ///< over variables of this step and earlier ones
  bool closes_loop = false;           ///< ties together frames that arrived far apart
};

/// A whole replay.
struct ReplayScript {
  std::string description;  ///< "49 cameras, 7776 points, …"
  /// the trust-region strategy this kind of problem is usually solved with; else
  /// Levenberg–Marquardt
  bool dogleg = false;
  std::vector<ReplayStep> steps;
};

/// Where the step's variables begin, the first of which has number `first`; `value` gives the
/// present value of those before it. The kinds of a variable and of the pose it starts from must go
/// together: both planar, or a pose or point in space and a pose.
std::vector<std::array<double, 9>> StartValues(const ReplayStep& step, int first,
                                               const std::function<const double*(int)>& value);

/// Of the script's steps as many as `max_steps` leaves; 0: all.
std::size_t NumSteps(const ReplayScript& script, int max_steps);

/// Whether a variable of the script is a landmark.
bool HasLandmarks(const ReplayScript& script);

}  // namespace inceres::tools
