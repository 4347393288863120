#pragma once

#include <array>
#include <string>
#include <variant>
#include <vector>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/inverse_depth_reprojection.h"
#include "inceres/factors/relative_pose.h"

namespace inceres::tools {

/// What a problem that arrives step by step is made of, whoever solves it. Variables are numbered 0, 1, 2, … in order of arrival,
/// over all steps; factors name them by that number.
struct ReplayVariable {
  enum class Kind {
    kBalCamera,      ///< 9: rotation vector, translation, f, k1, k2
    kBalCameraPose,  ///< the same with f, k1, k2 held constant
    kPoint,          ///< 3, a landmark
    kPose,           ///< 7 on PoseManifold: centre, world_from_camera quaternion x, y, z, w
    kInverseDepth,   ///< 1, a landmark
  };
  Kind kind = Kind::kPoint;
  std::array<double, 9> start{};  ///< only the first AmbientSize(kind) entries are used
  bool constant = false;
};

int AmbientSize(ReplayVariable::Kind kind);
int TangentSize(ReplayVariable::Kind kind);
bool IsLandmark(ReplayVariable::Kind kind);

struct ReplayFactor {
  std::variant<BalReprojectionFamily::Measurement, InverseDepthReprojectionFamily::Measurement, RelativePoseFamily::Measurement,
               DiagonalPriorFamily::Measurement>
      measurement;
  std::vector<int> variables;  ///< one per slot of the family
  double huber = 0.0;          ///< scale of the Huber loss; 0: no loss
};

struct ReplayStep {
  std::vector<ReplayVariable> variables;
  std::vector<ReplayFactor> factors;  ///< over variables of this step and earlier ones
  bool closes_loop = false;           ///< ties together frames that arrived far apart
};

/// A whole replay.
struct ReplayScript {
  std::string description;  ///< "49 cameras, 7776 points, …"
  bool dogleg = false;      ///< the trust-region strategy this kind of problem is usually solved with; else Levenberg–Marquardt
  std::vector<ReplayStep> steps;
};

}  // namespace inceres::tools
