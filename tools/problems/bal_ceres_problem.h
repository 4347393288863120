#pragma once

#include <memory>
#include <vector>

#include <ceres/ordered_groups.h>
#include <ceres/problem.h>

#include "inceres/io/bal.h"
#include "tools/problems/gauge.h"
#include "tools/problems/loss_spec.h"

namespace inceres::tools {

/// How a camera's rotation is stored.
enum class BalCameraModel {
  kAngleAxis,   ///< 9 doubles as in the file, Euclidean
  kQuaternion,  ///< 10 doubles [w x y z, t, f, k1, k2] with a product manifold, tangent size 9
};

/// Where the Jacobians of its cost functions come from.
enum class BalJacobians {
  kAutoDiff,         ///< ceres::AutoDiffCostFunction, as users of Ceres write them
  kInceresAutoDiff,  ///< inceres::AutoDiffCostFunction of the same functors
  kAnalytic,         ///< BalReprojectionFamily's; of kAngleAxis only
};

/// Doubles per camera of a model.
int CameraSize(BalCameraModel model);

/// The file's cameras in a model: num_cameras × CameraSize(model).
std::vector<double> CamerasIn(const BalProblem& bal, BalCameraModel model);

/// The problem as users of Ceres write it: one residual block an observation, in the order of the
/// file, over parameter blocks in the caller's arrays (cameras as CamerasIn lays them out; points
/// num_points × 3), which must outlive the result. `bal` supplies the observations only. Requires
/// bal.Validate().ok().
std::unique_ptr<ceres::Problem> BuildBalCeresProblem(
    const BalProblem& bal, const LossSpec& loss, double* cameras, double* points,
    BalCameraModel model = BalCameraModel::kAngleAxis,
    BalJacobians jacobians = BalJacobians::kAutoDiff);

/// The explicit elimination ordering: points in group 0, cameras in group 1. Only of blocks that an
/// observation touches.
std::shared_ptr<ceres::ParameterBlockOrdering> PointsFirstOrdering(
    const BalProblem& bal, double* cameras, double* points,
    BalCameraModel model = BalCameraModel::kAngleAxis);

/// The distance ‖r‖ between projected and observed position of each observation, in pixels; no
/// loss.
std::vector<double> ReprojectionErrors(const BalProblem& bal);

/// Root mean square over the observations of the distance ‖r‖ between projected and observed
/// position, in pixels; no loss.
double RmsReprojectionError(const BalProblem& bal);

/// Camera centers −Rᵀt and points, for comparisons and pictures.
SceneGeometry GeometryOf(const BalProblem& bal);

}  // namespace inceres::tools
