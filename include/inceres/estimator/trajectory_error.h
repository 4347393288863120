#pragma once

#include <array>
#include <vector>

#include "inceres/export.h"

namespace inceres {

/// Poses [p(3), q(x, y, z, w)] of a body in the world, in the order of time.
using Trajectory = std::vector<std::array<double, 7>>;

/// The absolute trajectory error of an estimate, meters: the root mean square of the distances
/// between its places and the true ones after the rotation and translation, no scale, that bring
/// them closest (Umeyama). Requires as many poses in both, three or more. Source: the evo tool's
/// evo_ape with --align; Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems",
/// 2012.
INCERES_EXPORT double AbsoluteTrajectoryError(const Trajectory& estimate, const Trajectory& truth);

/// What the relative pose error of a trajectory says.
struct RelativePoseError {
  double translation = 0.0;       ///< root mean square, meters
  double rotation_degrees = 0.0;  ///< root mean square
  int num_pairs = 0;              ///< pairs that the means are over
};

/// The error of the motion between consecutive pairs of poses, (T_i⁻¹ T_j)⁻¹ of the truth times
/// that of the estimate: `frames` ≥ 1 frames apart. Requires as many poses in both. Source:
/// evo_rpe.
INCERES_EXPORT RelativePoseError RelativePoseErrorOverFrames(const Trajectory& estimate,
                                                             const Trajectory& truth, int frames);

/// The same between pairs that are `meters` > 0 apart along the path of the estimate: a pair ends
/// where the path since the last one has got so long. Source: evo_rpe with --delta_unit m.
INCERES_EXPORT RelativePoseError RelativePoseErrorOverPath(const Trajectory& estimate,
                                                           const Trajectory& truth, double meters);

}  // namespace inceres
