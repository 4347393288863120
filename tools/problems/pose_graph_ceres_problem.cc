#include "tools/problems/pose_graph_ceres_problem.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <ceres/manifold.h>

#include "tools/problems/ceres_loss.h"
#include "tools/problems/pose_graph_cost.h"

namespace inceres::tools {
namespace {

// L with LᵀL = information; false if there is none.
template <int kSize>
bool SqrtInformation(const PoseGraphEdge& edge,
                     Eigen::Matrix<double, kSize, kSize>* sqrt_information) {
  using RowMajor = Eigen::Matrix<double, kSize, kSize, Eigen::RowMajor>;
  const Eigen::LLT<Eigen::Matrix<double, kSize, kSize>> cholesky(
      Eigen::Map<const RowMajor>(edge.information.data()));
  *sqrt_information = cholesky.matrixU();
  return cholesky.info() == Eigen::Success;
}

bool AddPlanarEdge(const PoseGraphEdge& edge, ceres::LossFunction* loss, double* from, double* to,
                   ceres::Problem* problem) {
  Eigen::Matrix3d sqrt_information;
  if (!SqrtInformation<3>(edge, &sqrt_information)) {
    return false;
  }
  const Eigen::Vector3d measured(edge.measurement.data());
  problem->AddResidualBlock(Se2BetweenError::Create(measured, sqrt_information), loss, from, to);
  return true;
}

bool AddSpatialEdge(const PoseGraphEdge& edge, ceres::LossFunction* loss, double* from, double* to,
                    ceres::Problem* problem) {
  Se3BetweenError::Matrix6d sqrt_information;
  if (!SqrtInformation<6>(edge, &sqrt_information)) {
    return false;
  }
  const Eigen::Vector3d position(edge.measurement.data());
  const Eigen::Quaterniond rotation(edge.measurement.data() + 3);
  problem->AddResidualBlock(Se3BetweenError::Create(position, rotation, sqrt_information), loss,
                            from, from + 3, to, to + 3);
  return true;
}

void SetManifoldsAndConstants(const PoseGraph& graph, double* poses, ceres::Problem* problem) {
  const int size = graph.PoseSize();
  if (graph.dimension == 3) {
    // owned by the problem; an edge has two quaternions
    auto* manifold = new ceres::EigenQuaternionManifold;
    for (int i = 0; i < graph.NumVertices(); ++i) {
      double* quaternion = poses + static_cast<std::ptrdiff_t>(i) * size + 3;
      if (problem->HasParameterBlock(quaternion)) {
        problem->SetManifold(quaternion, manifold);
      }
    }
  }
  const std::vector<int> fixed = graph.fixed.empty() ? std::vector<int>{0} : graph.fixed;
  for (const int vertex : fixed) {
    double* pose = poses + static_cast<std::ptrdiff_t>(vertex) * size;
    for (double* block : {pose, pose + 3}) {
      if ((block == pose || graph.dimension == 3) && problem->HasParameterBlock(block)) {
        problem->SetParameterBlockConstant(block);
      }
    }
  }
}

double PositionSpread(const PoseGraph& graph, const std::vector<double>& poses) {
  SceneGeometry scene;
  for (int i = 0; i < graph.NumVertices(); ++i) {
    const double* pose = poses.data() + static_cast<std::ptrdiff_t>(i) * graph.PoseSize();
    scene.centers.emplace_back(pose[0], pose[1], graph.dimension == 3 ? pose[2] : 0.0);
  }
  return SceneSize(scene);
}

}  // namespace

Status BuildPoseGraphCeresProblem(const PoseGraph& graph, const LossSpec& loss, double* poses,
                                  std::unique_ptr<ceres::Problem>* problem) {
  if (graph.edges.empty()) {
    return Status::Error(StatusCode::kInvalidArgument, "the pose graph has no edges");
  }
  auto result = std::make_unique<ceres::Problem>();
  // The problem owns the loss from the first block on that uses it, and counts its uses.
  std::unique_ptr<ceres::LossFunction> owned_loss = MakeCeresLoss(loss);
  ceres::LossFunction* shared_loss = owned_loss.get();
  for (std::size_t i = 0; i < graph.edges.size(); ++i) {
    const PoseGraphEdge& edge = graph.edges[i];
    double* from = poses + static_cast<std::ptrdiff_t>(edge.from) * graph.PoseSize();
    double* to = poses + static_cast<std::ptrdiff_t>(edge.to) * graph.PoseSize();
    const bool added = graph.dimension == 2
                           ? AddPlanarEdge(edge, shared_loss, from, to, result.get())
                           : AddSpatialEdge(edge, shared_loss, from, to, result.get());
    if (!added) {
      return Status::Error(
          StatusCode::kInvalidArgument,
          "edge " + std::to_string(i) + ": the information matrix is not positive definite");
    }
    static_cast<void>(owned_loss.release());  // the problem owns it now
  }
  SetManifoldsAndConstants(graph, poses, result.get());
  *problem = std::move(result);
  return Status::Ok();
}

GeometryDifference PoseDifference(const PoseGraph& graph, const std::vector<double>& a,
                                  const std::vector<double>& b) {
  GeometryDifference difference;
  const int num_coordinates = graph.dimension;
  for (int i = 0; i < graph.NumVertices(); ++i) {
    const double* pose_a = a.data() + static_cast<std::ptrdiff_t>(i) * graph.PoseSize();
    const double* pose_b = b.data() + static_cast<std::ptrdiff_t>(i) * graph.PoseSize();
    const Eigen::Map<const Eigen::VectorXd> p_a(pose_a, num_coordinates);
    const Eigen::Map<const Eigen::VectorXd> p_b(pose_b, num_coordinates);
    difference.positions = std::max(difference.positions, (p_a - p_b).norm());
    const double angle =
        graph.dimension == 2
            ? std::abs(std::remainder(pose_a[2] - pose_b[2], 2.0 * M_PI))
            : Eigen::Map<const Eigen::Quaterniond>(pose_a + 3)
                  .angularDistance(Eigen::Map<const Eigen::Quaterniond>(pose_b + 3));
    difference.rotations = std::max(difference.rotations, angle);
  }
  difference.positions /= PositionSpread(graph, b);
  return difference;
}

}  // namespace inceres::tools
