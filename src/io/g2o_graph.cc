#include "inceres/io/g2o_graph.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <numeric>
#include <type_traits>
#include <utility>

#include <Eigen/Eigenvalues>

#include "inceres/factors/pose_prior.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"
#include "io/pose_graph.h"

// Pose graphs as factor graphs. What an information matrix means depends on how the program that
// wrote it writes the error of an edge (docs/pose_graphs.md, "Conventions"): the order of its
// parts, the axes that the position's error stands in, whether the rotation's is a rotation vector
// or half of it. So a file's numbers are converted into the residual of the family that stands for
// the convention, exactly where that is a change of coordinates (order, sign, axes) and by a family
// of its own otherwise (PoseEdgeFamily).
//
// Every whitening is ‖U e‖² = eᵀ Ω e with the upper triangular U of SqrtInformation.

namespace inceres {
namespace {

// Of the largest: what ProjectInformation leaves at least.
constexpr double kLeastEigenvalue = 1e-9;

// The edges as measurements; all or, with the culprit's message, none.
template <typename Family>
Status ConvertEdges(const PoseGraph& poses, const PoseGraphOptions& options, Family* family) {
  const auto make = [&](const PoseGraphEdge& edge, auto* measurement) {
    if constexpr (std::is_same_v<Family, PlanarRelativePoseFamily>) {
      return ToMeasurement(edge, options.convention, measurement);
    } else {
      return ToMeasurement(edge, measurement);
    }
  };
  family->Reserve(poses.edges.size());
  for (std::size_t i = 0; i < poses.edges.size(); ++i) {
    // A copy: projecting changes its information, and the caller's graph stays as it is.
    PoseGraphEdge edge = poses.edges[i];
    typename Family::Measurement measurement;
    // Projection is tried only where the Cholesky factorization has failed, so that a good matrix
    // is used to the last bit as it is.
    bool made = make(edge, &measurement);
    if (!made && options.indefinite == IndefiniteInformation::kProject) {
      made = ProjectInformation(edge.information.data(), poses.TangentSize()) &&
             make(edge, &measurement);
    }
    if (!made) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "edge " + std::to_string(i) + ", from vertex " +
                               std::to_string(poses.ids[static_cast<std::size_t>(edge.from)]) +
                               " to " +
                               std::to_string(poses.ids[static_cast<std::size_t>(edge.to)]) +
                               ": the information matrix is not positive definite");
    }
    family->Add(measurement);
  }
  return Status::Ok();
}

// Whether the position's error stands in the axes of the measured pose.
bool IsInMeasuredAxes(PoseErrorConvention convention) {
  return convention == PoseErrorConvention::kG2o || convention == PoseErrorConvention::kGtsam;
}

// Planar poses are three Euclidean coordinates, the angle among them: PlanarRelativePoseFamily is
// what takes angles modulo 2π. Spatial ones share one manifold.
std::vector<VariableId> AddVertices(const PoseGraph& poses, FactorGraph* graph) {
  std::vector<VariableId> variables;
  variables.reserve(poses.ids.size());
  const auto manifold = poses.dimension == 2 ? nullptr : std::make_shared<PoseManifold>();
  for (int i = 0; i < poses.NumVertices(); ++i) {
    variables.push_back(
        graph->AddVariable(poses.PoseData(i), poses.PoseSize(), Role::kFrame, manifold));
  }
  for (const int vertex : poses.fixed) {
    graph->SetConstant(variables[static_cast<std::size_t>(vertex)], true);
  }
  return variables;
}

// A family of the edges' measurements, all or none, then its factors, in slots from, to or the
// other way around. The graph is touched only when every edge has been converted: an error leaves
// it as it was.
template <typename Family>
Status AddEdges(const PoseGraph& poses, const PoseGraphOptions& options, bool from_first,
                const std::shared_ptr<Family>& family, FactorGraph* graph,
                std::vector<VariableId>* variables, FamilyHandle<Family>* handle) {
  if (Status status = ConvertEdges(poses, options, family.get()); !status.ok()) {
    return status;
  }
  *variables = AddVertices(poses, graph);
  *handle = graph->AddFamily(family);
  for (const PoseGraphEdge& edge : poses.edges) {
    const VariableId from = (*variables)[static_cast<std::size_t>(edge.from)];
    const VariableId to = (*variables)[static_cast<std::size_t>(edge.to)];
    const VariableId ends[] = {from_first ? from : to, from_first ? to : from};
    graph->Connect(handle->id, ends, options.loss);
  }
  return Status::Ok();
}

}  // namespace

std::vector<int> VerticesById(const PoseGraph& poses) {
  std::vector<int> order(poses.ids.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&poses](int a, int b) {
    return poses.ids[static_cast<std::size_t>(a)] < poses.ids[static_cast<std::size_t>(b)];
  });
  return order;
}

// By position in the order of ids and not by difference of ids, which may have gaps. An end that is
// no vertex has no position, and no neighbor.
std::vector<int> LoopEdges(const PoseGraph& poses) {
  const std::vector<int> order = VerticesById(poses);
  // The inverse of `order`: where each vertex stands among the ids.
  std::vector<int> position(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    position[static_cast<std::size_t>(order[i])] = static_cast<int>(i);
  }
  const auto is_vertex = [&poses](int end) { return end >= 0 && end < poses.NumVertices(); };
  std::vector<int> loops;
  for (std::size_t i = 0; i < poses.edges.size(); ++i) {
    const int from = poses.edges[i].from, to = poses.edges[i].to;
    const bool joins = is_vertex(from) && is_vertex(to);
    if (!joins || std::abs(position[static_cast<std::size_t>(from)] -
                           position[static_cast<std::size_t>(to)]) != 1) {
      loops.push_back(static_cast<int>(i));
    }
  }
  return loops;
}

// The family's residual is g2o's but for the axes of the position: parts and slots are in the
// file's order.
bool ToMeasurement(const PoseGraphEdge& edge, PlanarRelativePoseFamily::Measurement* measurement) {
  std::copy_n(edge.measurement.begin(), 3, measurement->motion);
  return SqrtInformation(edge.information.data(), 3, measurement->sqrt_information);
}

// RelativePoseFamily's a is the edge's `to`, its b `from`: then R_abᵀ is the measured rotation and
// p_ab the measured position. Its rotation residual, which comes first, is minus the rotation
// vector of q_m* q_from* q_to.
bool ToMeasurement(const PoseGraphEdge& edge, RelativePoseFamily::Measurement* measurement) {
  std::copy_n(edge.measurement.begin(), 3, measurement->p_ab);
  ConjugateQuaternion(edge.measurement.data() + 3, measurement->q_ab);
  // Blocks change places, rotation before position; the sign of the rotation turns that of the
  // blocks between the two.
  double information[36];
  for (std::size_t r = 0; r < 6; ++r) {
    for (std::size_t c = 0; c < 6; ++c) {
      const double sign = (r < 3) == (c < 3) ? 1.0 : -1.0;
      information[6 * r + c] = sign * edge.information[6 * ((r + 3) % 6) + (c + 3) % 6];
    }
  }
  return SqrtInformation(information, 6, measurement->sqrt_information);
}

// PoseEdgeFamily has the order, slots and signs of the file, in whichever convention.
bool ToMeasurement(const PoseGraphEdge& edge, PoseEdgeFamily::Measurement* measurement) {
  std::copy_n(edge.measurement.begin(), 3, measurement->p_m);
  std::copy_n(edge.measurement.begin() + 3, 4, measurement->q_m);
  return SqrtInformation(edge.information.data(), 6, measurement->sqrt_information);
}

// The error in the measured axes is R_mᵀ times that in the axes of `from`: Ω there is R_m Ω R_mᵀ
// here.
bool ToMeasurement(const PoseGraphEdge& edge, PoseErrorConvention convention,
                   PlanarRelativePoseFamily::Measurement* measurement) {
  PoseGraphEdge turned = edge;
  if (IsInMeasuredAxes(convention)) {
    using Matrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    const double c = std::cos(edge.measurement[2]), s = std::sin(edge.measurement[2]);
    Matrix3 R;
    R << c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0;
    Eigen::Map<Matrix3> information(turned.information.data());
    // Symmetric in exact arithmetic; averaged, for rounding leaves it nearly so.
    const Matrix3 product = R * information * R.transpose();
    information = 0.5 * (product + product.transpose());
  }
  return ToMeasurement(turned, measurement);
}

// The nearest in the Frobenius norm keeps the eigenvectors and raises what is below the limit. The
// least eigenvalue is not 0, for the square root is a Cholesky factor, which wants a definite
// matrix.
bool ProjectInformation(double* information, int size) {
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, 6, 6>;
  Eigen::Map<Matrix> M(information, size, size);
  if (!M.allFinite()) {
    return false;
  }
  const Eigen::MatrixXd symmetric = 0.5 * (M + M.transpose());
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(symmetric);
  const double largest = eigen.eigenvalues()[size - 1];
  if (!(largest > 0.0) || eigen.eigenvalues()[0] >= kLeastEigenvalue * largest) {
    return false;
  }
  const Eigen::VectorXd raised = eigen.eigenvalues().cwiseMax(kLeastEigenvalue * largest);
  M = eigen.eigenvectors() * raised.asDiagonal() * eigen.eigenvectors().transpose();
  return true;
}

Status AddPoseGraph(const PoseGraph& poses, const std::shared_ptr<const Loss>& loss,
                    FactorGraph* graph, G2oGraph* ids) {
  PoseGraphOptions options;
  options.loss = loss;
  return AddPoseGraph(poses, options, graph, ids);
}

// Three families: planar edges in any convention; spatial ones with the geodesic error, which
// RelativePoseFamily measures between `to` and `from`; spatial ones in another program's
// convention.
Status AddPoseGraph(const PoseGraph& poses, const PoseGraphOptions& options, FactorGraph* graph,
                    G2oGraph* ids) {
  G2oGraph added;
  Status status = internal::CheckPoseGraph(poses);
  if (!status.ok()) {
    return status;
  }
  if (poses.dimension == 2) {
    status = AddEdges(poses, options, true, std::make_shared<PlanarRelativePoseFamily>(), graph,
                      &added.poses, &added.planar);
  } else if (options.convention == PoseErrorConvention::kGeodesic) {
    status = AddEdges(poses, options, false, std::make_shared<RelativePoseFamily>(), graph,
                      &added.poses, &added.spatial);
  } else {
    status = AddEdges(poses, options, true, std::make_shared<PoseEdgeFamily>(options.convention),
                      graph, &added.poses, &added.edges);
  }
  if (status.ok() && ids != nullptr) {
    *ids = std::move(added);
  }
  return status;
}

Status ReadG2o(const std::string& path, FactorGraph* graph, G2oGraph* ids,
               const GraphReadOptions& options) {
  PoseGraph poses;
  const Status status = ReadG2o(path, &poses, options.file);
  if (!status.ok()) {
    return status;
  }
  // An edge's fault is named by AddPoseGraph, which knows of no file.
  Status added = AddPoseGraph(poses, options.loss, graph, ids);
  if (!added.ok()) {
    added.message = path + ": " + added.message;
  }
  return added;
}

}  // namespace inceres
