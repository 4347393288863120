#pragma once

#include <memory>
#include <optional>
#include <type_traits>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "inceres/factors/pose_prior.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/covariance.h"
#include "inceres/solver/incremental_solver.h"

/// Eigen's types for the core's plain arrays. Headers only, and optional: the library neither
/// includes nor links Eigen, and a program that includes this has Eigen 3.3 or later itself
/// (find_package(Eigen3), target Eigen3::Eigen).
///
/// Vectors and matrices of Eigen are stored by columns, those of inceres by rows: what is given to
/// the functions below may be either, and any expression.
namespace inceres {

/// Adds a variable with the values of a vector, to a FactorGraph or, in a transaction, a GraphEdit:
/// AddVariable(&graph, Eigen::Vector3d(1, 2, 3), Role::kLandmark).
template <typename Graph, typename Vector>
VariableId AddVariable(Graph* graph, const Eigen::MatrixBase<Vector>& values, Role role,
                       std::shared_ptr<const Manifold> manifold = nullptr) {
  static_assert(Vector::IsVectorAtCompileTime, "the values of a variable are a vector");
  static_assert(std::is_same_v<typename Vector::Scalar, double>, "values are doubles");
  const Eigen::VectorXd copy = values;
  return graph->AddVariable(copy.data(), static_cast<int>(copy.size()), role, std::move(manifold));
}

/// Overwrites the values of a variable of a FactorGraph or, in a transaction, by a GraphEdit. The
/// vector must be of its ambient size.
template <typename Graph, typename Vector>
void SetValues(Graph* graph, VariableId id, const Eigen::MatrixBase<Vector>& values) {
  static_assert(Vector::IsVectorAtCompileTime, "the values of a variable are a vector");
  const Eigen::VectorXd copy = values.template cast<double>();
  graph->SetValues(id, copy.data());
}

/// The values of a variable, where the graph keeps them: good until a variable is added or the
/// graph goes. ValuesOf<3>(graph, id) has its size at compile time, which must be the ambient one.
template <int kSize = Eigen::Dynamic>
Eigen::Map<const Eigen::Matrix<double, kSize, 1>> ValuesOf(const FactorGraph& graph,
                                                           VariableId id) {
  return Eigen::Map<const Eigen::Matrix<double, kSize, 1>>(graph.Values(id), graph.AmbientSize(id));
}
/// The same of what an IncrementalSolver holds: good until its next Apply, Update or Marginalize.
template <int kSize = Eigen::Dynamic>
Eigen::Map<const Eigen::Matrix<double, kSize, 1>> ValuesOf(const IncrementalSolver& solver,
                                                           VariableId id) {
  return Eigen::Map<const Eigen::Matrix<double, kSize, 1>>(solver.Values(id),
                                                           solver.graph().AmbientSize(id));
}
/// The same of a snapshot, which does not know the size: give it. The snapshot must have the
/// variable.
template <int kSize>
Eigen::Map<const Eigen::Matrix<double, kSize, 1>> ValuesOf(const ValueSnapshot& snapshot,
                                                           VariableId id) {
  return Eigen::Map<const Eigen::Matrix<double, kSize, 1>>(snapshot.Values(id));
}

/// A unit quaternion as inceres stores it but for QuaternionManifold, x, y, z, w, which is how
/// Eigen stores its own: seen in place.
inline Eigen::Map<const Eigen::Quaterniond> QuaternionAt(const double* xyzw) {
  return Eigen::Map<const Eigen::Quaterniond>(xyzw);
}
/// Of a variable on QuaternionManifold, which stores w, x, y, z as Ceres does: copied.
inline Eigen::Quaterniond QuaternionAtWxyz(const double* wxyz) {
  return {wxyz[0], wxyz[1], wxyz[2], wxyz[3]};
}
/// What a variable on QuaternionManifold stores: w, x, y, z.
inline Eigen::Vector4d WxyzOf(const Eigen::Quaterniond& q) {
  return {q.w(), q.x(), q.y(), q.z()};
}

/// A pose as the pose manifolds and built-in factors store it, [p(3), q(x, y, z, w)],
/// world_from_body for a body in the world.
inline Eigen::Matrix<double, 7, 1> PoseValues(const Eigen::Isometry3d& pose) {
  Eigen::Matrix<double, 7, 1> values;
  values << pose.translation(), Eigen::Quaterniond(pose.linear()).normalized().coeffs();
  return values;
}
/// The pose that seven values are.
inline Eigen::Isometry3d PoseAt(const double* values) {
  return Eigen::Translation3d(values[0], values[1], values[2]) * QuaternionAt(values + 3);
}
/// Adds a pose on PoseManifold.
template <typename Graph>
VariableId AddPose(Graph* graph, const Eigen::Isometry3d& pose) {
  return AddVariable(graph, PoseValues(pose), Role::kFrame, std::make_shared<PoseManifold>());
}

/// Writes U with UᵀU = information row by row, as measurements keep it. False if the matrix is not
/// square or not positive definite; of its lower triangle nothing is read.
template <typename Matrix>
[[nodiscard]] bool SqrtInformation(const Eigen::MatrixBase<Matrix>& information, double* U) {
  const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> by_rows =
      information;
  return by_rows.rows() == by_rows.cols() &&
         SqrtInformation(by_rows.data(), static_cast<int>(by_rows.rows()), U);
}

/// The block cov(a, b) of a covariance that was computed for this graph: tangent size of a × of b.
/// Empty if it was not computed.
inline std::optional<Eigen::MatrixXd> CovarianceBlock(const GraphCovariance& covariance,
                                                      const FactorGraph& graph, VariableId a,
                                                      VariableId b) {
  if (!graph.HasVariable(a) || !graph.HasVariable(b)) {
    return std::nullopt;
  }
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> block(
      graph.TangentSize(a), graph.TangentSize(b));
  return covariance.Get(a, b, block.data()) ? std::optional<Eigen::MatrixXd>(block) : std::nullopt;
}

}  // namespace inceres
