#include "tools/problems/bal_ceres_problem.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>

#include <ceres/manifold.h>
#include <ceres/product_manifold.h>
#include <ceres/rotation.h>

#include "inceres/factors/bal_reprojection.h"
#include "tools/problems/bal_cost.h"
#include "tools/problems/ceres_loss.h"
#include "tools/problems/factor_cost_function.h"

namespace inceres::tools {
namespace {

using QuaternionCameraManifold =
    ceres::ProductManifold<ceres::QuaternionManifold, ceres::EuclideanManifold<6>>;

double* Block(double* blocks, int index, int size) {
  return blocks + static_cast<std::ptrdiff_t>(index) * size;
}

template <template <typename, int, int...> class AutoDiff>
ceres::CostFunction* CostByAutoDiff(const BalObservation& observation, BalCameraModel model) {
  return model == BalCameraModel::kAngleAxis
             ? BalReprojectionError::Create<AutoDiff>(observation)
             : BalQuaternionReprojectionError::Create<AutoDiff>(observation);
}

ceres::CostFunction* CostOf(const BalObservation& observation, BalCameraModel model,
                            BalJacobians jacobians) {
  if (jacobians == BalJacobians::kAnalytic) {
    assert(model == BalCameraModel::kAngleAxis);
    return MakeFactorCost<BalReprojectionFamily>({observation.x, observation.y});
  }
  return jacobians == BalJacobians::kInceresAutoDiff
             ? CostByAutoDiff<AutoDiffCostFunction>(observation, model)
             : CostByAutoDiff<ceres::AutoDiffCostFunction>(observation, model);
}

}  // namespace

int CameraSize(BalCameraModel model) {
  return model == BalCameraModel::kAngleAxis ? BalProblem::kCameraSize : 10;
}

std::vector<double> CamerasIn(const BalProblem& bal, BalCameraModel model) {
  if (model == BalCameraModel::kAngleAxis) {
    return bal.cameras;
  }
  std::vector<double> cameras(static_cast<std::size_t>(bal.num_cameras) * 10);
  for (int i = 0; i < bal.num_cameras; ++i) {
    double* camera = Block(cameras.data(), i, 10);
    ceres::AngleAxisToQuaternion(bal.CameraData(i), camera);
    std::copy_n(bal.CameraData(i) + 3, 6, camera + 4);
  }
  return cameras;
}

std::unique_ptr<ceres::Problem> BuildBalCeresProblem(const BalProblem& bal, const LossSpec& loss,
                                                     double* cameras, double* points,
                                                     BalCameraModel model, BalJacobians jacobians) {
  auto problem = std::make_unique<ceres::Problem>();
  // owned by the problem, which counts its uses
  ceres::LossFunction* shared_loss = MakeCeresLoss(loss).release();
  for (const BalObservation& observation : bal.observations) {
    problem->AddResidualBlock(CostOf(observation, model, jacobians), shared_loss,
                              Block(cameras, observation.camera, CameraSize(model)),
                              Block(points, observation.point, BalProblem::kPointSize));
  }
  if (model == BalCameraModel::kQuaternion) {
    // owned by the problem; at least one camera is observed
    auto* manifold = new QuaternionCameraManifold;
    for (int i = 0; i < bal.num_cameras; ++i) {
      double* camera = Block(cameras, i, CameraSize(model));
      if (problem->HasParameterBlock(camera)) {
        problem->SetManifold(camera, manifold);
      }
    }
  }
  return problem;
}

std::shared_ptr<ceres::ParameterBlockOrdering> PointsFirstOrdering(const BalProblem& bal,
                                                                   double* cameras, double* points,
                                                                   BalCameraModel model) {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (const BalObservation& observation : bal.observations) {
    ordering->AddElementToGroup(Block(points, observation.point, BalProblem::kPointSize), 0);
    ordering->AddElementToGroup(Block(cameras, observation.camera, CameraSize(model)), 1);
  }
  return ordering;
}

std::vector<double> ReprojectionErrors(const BalProblem& bal) {
  std::vector<double> errors;
  errors.reserve(bal.observations.size());
  for (const BalObservation& observation : bal.observations) {
    double r[2];
    BalReprojectionError{{observation.x, observation.y}}(bal.CameraData(observation.camera),
                                                         bal.PointData(observation.point), r);
    errors.push_back(std::hypot(r[0], r[1]));
  }
  return errors;
}

double RmsReprojectionError(const BalProblem& bal) {
  double sum = 0.0;
  for (const BalObservation& observation : bal.observations) {
    double r[2];
    BalReprojectionError{{observation.x, observation.y}}(bal.CameraData(observation.camera),
                                                         bal.PointData(observation.point), r);
    sum += r[0] * r[0] + r[1] * r[1];
  }
  return std::sqrt(sum / static_cast<double>(bal.observations.size()));
}

SceneGeometry GeometryOf(const BalProblem& bal) {
  SceneGeometry scene;
  for (int i = 0; i < bal.num_cameras; ++i) {
    const double* camera = bal.CameraData(i);
    const double inverse_rotation[3] = {-camera[0], -camera[1], -camera[2]};
    Eigen::Vector3d center;
    ceres::AngleAxisRotatePoint(inverse_rotation, camera + 3, center.data());
    scene.centers.emplace_back(-center);
  }
  for (int i = 0; i < bal.num_points; ++i) {
    scene.points.emplace_back(Eigen::Map<const Eigen::Vector3d>(bal.PointData(i)));
  }
  return scene;
}

}  // namespace inceres::tools
