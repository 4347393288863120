#include "inceres/io/pose_graph_start.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <utility>

#include <Eigen/Dense>

#include "inceres/factors/pose_prior.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/rotation.h"
#include "inceres/solver/solver.h"
#include "io/pose_graph.h"

// The chordal start (Martinec & Pajdla 2007; Carlone et al. 2015; docs/pose_graphs.md, "Start
// values"). A pose graph's cost has many minima because of the constraint RᵀR = I; without it, the
// equations of the rotations are linear,
//
//     min Σ κ ‖R_j − R_i R_ij‖²_F,
//
// and with the rotations known those of the positions are too,
//
//     min Σ ‖U_t R_iᵀ (p_j − p_i − R_i p_ij)‖².
//
// So two linear least-squares problems, with a projection onto the rotations between them, need no
// start. In the first, the rows of R do not mix: each of the three is a problem of its own with the
// same matrix, and a planar rotation is one problem of two values.
//
// Kept from call to call are the structures of both systems, which do not depend on the weights
// that GNC changes.

namespace inceres {
namespace {

using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor, 6, 6>;
using Matrix3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// Of the edges: with more of them at weight zero, leaving their blocks out of H pays.
constexpr double kSparseShare = 0.05;

struct LinearDifference {
  double U[9] = {};  // row-major, size × size, as A
  double A[9] = {};
  double t[3] = {};
};

// U (x_j − A x_i − t) of two vectors of `size` values, 2 or 3, in slots i and j: linear.
class LinearDifferenceFamily final
    : public MeasuredFamily<LinearDifference, AmbientFamily<LinearDifferenceFamily>> {
 public:
  explicit LinearDifferenceFamily(int size)
      : MeasuredFamily(size, {{size, size}, {size, size}}), size_(size) {}

  const char* Name() const override { return "linear difference"; }
  bool HasConstantJacobian() const override { return true; }

  bool EvaluateOne(int i, const double* const* x, double* residuals, double** jacobians) const {
    const LinearDifference& m = measurement(i);
    double e[3];
    for (int r = 0; r < size_; ++r) {
      e[r] = x[1][r] - m.t[r];
      for (int c = 0; c < size_; ++c) {
        e[r] -= m.A[size_ * r + c] * x[0][c];
      }
    }
    for (int r = 0; r < size_; ++r) {
      residuals[r] = 0.0;
      for (int k = 0; k < size_; ++k) {
        residuals[r] += m.U[size_ * r + k] * e[k];
      }
    }
    for (int s = 0; jacobians != nullptr && s < 2; ++s) {
      if (jacobians[s] != nullptr) {
        Differentiate(m, s, jacobians[s]);
      }
    }
    return true;
  }

 private:
  void Differentiate(const LinearDifference& m, int slot, double* J) const {
    for (int r = 0; r < size_; ++r) {
      for (int c = 0; c < size_; ++c) {
        double sum = slot == 1 ? m.U[size_ * r + c] : 0.0;
        for (int k = 0; slot == 0 && k < size_; ++k) {
          sum -= m.U[size_ * r + k] * m.A[size_ * k + c];
        }
        J[size_ * r + c] = sum;
      }
    }
  }

  int size_;
};

// min Σ ‖U (x_j − A x_i − t)‖² over vectors of one size, the first of which stays at its value.
class LinearChain {
 public:
  LinearChain(const PoseGraph& poses, int size, int num_threads)
      : family_(std::make_shared<LinearDifferenceFamily>(size)) {
    options_.num_threads = num_threads;
    // A linear problem ends with its first Gauss–Newton step: the largest radius leaves no damping
    // to speak of.
    options_.max_num_iterations = 1;
    options_.initial_trust_region_radius = options_.max_trust_region_radius;
    const std::vector<double> zero(static_cast<std::size_t>(size), 0.0);
    for (int i = 0; i < poses.NumVertices(); ++i) {
      graph_.AddVariable(zero.data(), size, Role::kFrame);
    }
    // Takes away the gauge: without it, every common motion would be a solution too.
    if (poses.NumVertices() > 0) {
      graph_.SetConstant(0, true);
    }
    const FamilyId id = graph_.AddFamily(family_).id;
    for (const PoseGraphEdge& edge : poses.edges) {
      family_->Add({});
      const VariableId variables[] = {edge.from, edge.to};
      graph_.Connect(id, variables);
    }
  }

  // To be set of each edge before Solve.
  void Place(std::size_t edge, const LinearDifference& measurement) {
    family_->Place(static_cast<int>(edge), measurement);
  }

  // False if the system has no solution. The values are then x(i).
  // From zeros each time, so that a result depends on its input alone and not on the calls before.
  bool Solve(const double* first, bool mostly_zero) {
    std::fill(graph_.mutable_state().begin(), graph_.mutable_state().end(), 0.0);
    graph_.SetValues(0, first);
    // Nothing to solve for.
    if (graph_.num_variables() == 1) {
      return true;
    }
    // Edges of weight zero have zero blocks, which then are left out of the elimination's pattern.
    options_.dynamic_sparsity = mostly_zero;
    const Summary summary = solver_.Solve(options_, &graph_);
    return summary.IsSolutionUsable();
  }

  const double* x(int i) const { return graph_.Values(i); }

 private:
  std::shared_ptr<LinearDifferenceFamily> family_;
  FactorGraph graph_;
  SolverOptions options_;
  Solver solver_;
};

// The rotation nearest to M in the Frobenius norm: its polar factor of determinant 1.
// With the determinant −1, the least singular value's axis is turned around: that is the nearest of
// determinant 1. No matrix is refused, not even zero.
Matrix3d NearestRotation(const Matrix3d& M) {
  // M = U Σ Vᵀ, and the nearest rotation is U diag(1, 1, ±1) Vᵀ; singular values are sorted, so the
  // last one is the least.
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(M, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  signs[2] = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  return svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
}

Status Refuse(const std::string& what) {
  return Status::Error(StatusCode::kInvalidArgument, "chordal start: " + what);
}

}  // namespace

class ChordalStart::Impl {
 public:
  // Both chains have the vertices and edges of the graph and vectors of d values; only their
  // measurements differ. They need edges with ends: of a graph that does not fit together nothing
  // is kept but what is wrong with it, for Compute to tell.
  Impl(const PoseGraph& graph, int num_threads)
      : fits_together_(internal::CheckPoseGraph(graph)),
        graph_(fits_together_.ok() ? graph : PoseGraph()),
        d_(graph_.dimension),
        rotations_(graph_, d_, num_threads),
        positions_(graph_, d_, num_threads) {}

  Status Compute(const std::vector<double>& weights, std::vector<double>* poses);

 private:
  Status Check(const std::vector<double>& weights) const;
  void MeasureRotations();
  bool SolveRotations();
  void MeasurePositions();
  double Weight(std::size_t edge) const { return weights_.empty() ? 1.0 : weights_[edge]; }
  double RotationWeight(const PoseGraphEdge& edge) const;
  Matrix3d Measured(const PoseGraphEdge& edge) const;
  void WritePoses(std::vector<double>* poses) const;

  const Status fits_together_;
  // A copy: the caller's may change or end between two calls.
  const PoseGraph graph_;
  const int d_;
  LinearChain rotations_;
  LinearChain positions_;
  std::vector<double> weights_;
  bool mostly_zero_ = false;
  std::vector<Matrix3d> R_;  // of each vertex; planar: the upper left 2 × 2
};

// Without an edge of positive weight to it, a vertex would be anywhere, and the system singular:
// walking along those edges finds it, and names it.
Status ChordalStart::Impl::Check(const std::vector<double>& weights) const {
  if (!fits_together_.ok()) {
    return fits_together_;
  }
  if (graph_.ids.empty()) {
    return Refuse("the graph has no vertices");
  }
  if (!weights.empty() && weights.size() != graph_.edges.size()) {
    return Refuse(std::to_string(weights.size()) + " weights for " +
                  std::to_string(graph_.edges.size()) + " edges");
  }
  // Ids and edges only; PlaceAlongEdges makes the poses.
  PoseGraph counted;
  counted.dimension = graph_.dimension;
  counted.ids = graph_.ids;
  for (std::size_t i = 0; i < graph_.edges.size(); ++i) {
    if (!weights.empty() && !(weights[i] >= 0.0 && std::isfinite(weights[i]))) {
      return Refuse("the weight of edge " + std::to_string(i) + " is " +
                    std::to_string(weights[i]));
    }
    if (weights.empty() || weights[i] > 0.0) {
      counted.edges.push_back(graph_.edges[i]);
    }
  }
  const int lost = internal::PlaceAlongEdges(&counted);
  return lost == graph_.NumVertices() ? Status::Ok() : Refuse(internal::NoWay(graph_, lost));
}

// An isotropic κ in place of the information of the rotation: what the trace of its covariance says
// (Rosen et al., "SE-Sync", IJRR 2019, section 3.1).
double ChordalStart::Impl::RotationWeight(const PoseGraphEdge& edge) const {
  const Eigen::Index size = graph_.TangentSize();
  const SmallMatrix information =
      Eigen::Map<const SmallMatrix>(edge.information.data(), size, size);
  // |z_j − z_i z_ij|² is half of ‖R_j − R_i R_ij‖²_F, so this is twice the κ of that.
  if (d_ == 2) {
    return information(2, 2);
  }
  const Eigen::Matrix3d rotation = information.bottomRightCorner<3, 3>();
  // An information without an inverse still has a trace: a third of it is the mean per axis, and κ
  // is half of that.
  const double trace = rotation.inverse().trace();
  return trace > 0.0 && std::isfinite(trace) ? 3.0 / (2.0 * trace) : rotation.trace() / 6.0;
}

Matrix3d ChordalStart::Impl::Measured(const PoseGraphEdge& edge) const {
  Matrix3d R = Matrix3d::Identity();
  if (d_ == 3) {
    QuaternionToMatrix(edge.measurement.data() + 3, R.data());
  } else {
    const double c = std::cos(edge.measurement[2]), s = std::sin(edge.measurement[2]);
    R.topLeftCorner<2, 2>() << c, -s, s, c;
  }
  return R;
}

// Planar: z_j = z_i z_ij, so A = R_ij; spatial, row by row: r_j = R_ijᵀ r_i.
void ChordalStart::Impl::MeasureRotations() {
  for (std::size_t i = 0; i < graph_.edges.size(); ++i) {
    const PoseGraphEdge& edge = graph_.edges[i];
    // The weight of GNC and κ are both weights of the squared error.
    const double root = std::sqrt(Weight(i) * RotationWeight(edge));
    const Matrix3d R = Measured(edge);
    LinearDifference m;
    for (int r = 0; r < d_; ++r) {
      for (int c = 0; c < d_; ++c) {
        // U = √(w κ) I, since κ is isotropic.
        m.A[d_ * r + c] = d_ == 2 ? R(r, c) : R(c, r);
        m.U[d_ * r + c] = r == c ? root : 0.0;
      }
    }
    rotations_.Place(i, m);
  }
}

// Row by row into R_, row-major, then each R_ onto the nearest rotation. In the plane z = (cos θ,
// sin θ) is the first row of Rᵀ, and is kept in the first row until it is normalized.
bool ChordalStart::Impl::SolveRotations() {
  const int num_vertices = graph_.NumVertices();
  R_.assign(static_cast<std::size_t>(num_vertices), Matrix3d::Zero());
  Matrix3d first = Matrix3d::Identity();
  if (d_ == 3) {
    QuaternionToMatrix(graph_.PoseData(0) + 3, first.data());
  }
  const double z[2] = {std::cos(graph_.PoseData(0)[2]), std::sin(graph_.PoseData(0)[2])};
  // One matrix for all rows: the structure is analyzed once.
  for (int row = 0; row < (d_ == 2 ? 1 : 3); ++row) {
    if (!rotations_.Solve(d_ == 2 ? z : first.data() + 3 * row, mostly_zero_)) {
      return false;
    }
    for (int i = 0; i < num_vertices; ++i) {
      std::copy_n(rotations_.x(i), d_, R_[static_cast<std::size_t>(i)].data() + 3 * row);
    }
  }
  for (Matrix3d& R : R_) {
    if (d_ == 3) {
      R = NearestRotation(R);
    } else {
      // The nearest rotation of a z is z / |z|. A zero has none and stays zero, whose angle is 0.
      const double c = R(0, 0), s = R(0, 1), norm = std::hypot(c, s);
      R.topLeftCorner<2, 2>() << c, -s, s, c;
      R.topLeftCorner<2, 2>() /= norm > 0.0 ? norm : 1.0;
    }
  }
  return true;
}

// A = I and t = R_i p_ij; the information of the file is about the axes of `from`, so its square
// root comes behind R_iᵀ.
void ChordalStart::Impl::MeasurePositions() {
  const Eigen::Index size = graph_.TangentSize();
  for (std::size_t i = 0; i < graph_.edges.size(); ++i) {
    const PoseGraphEdge& edge = graph_.edges[i];
    const SmallMatrix information =
        Eigen::Map<const SmallMatrix>(edge.information.data(), size, size);
    const SmallMatrix position = information.topLeftCorner(d_, d_);
    SmallMatrix U(d_, d_);
    // A start value needs no exact weight: an indefinite one counts as 1.
    if (!SqrtInformation(position.data(), d_, U.data())) {
      U.setIdentity();
    }
    const SmallMatrix R = R_[static_cast<std::size_t>(edge.from)].topLeftCorner(d_, d_);
    const Eigen::VectorXd t = R * Eigen::Map<const Eigen::VectorXd>(edge.measurement.data(), d_);
    const SmallMatrix whiten = std::sqrt(Weight(i)) * U * R.transpose();
    LinearDifference m;
    for (int r = 0; r < d_; ++r) {
      m.t[r] = t[r];
      for (int c = 0; c < d_; ++c) {
        m.A[d_ * r + c] = r == c ? 1.0 : 0.0;
        m.U[d_ * r + c] = whiten(r, c);
      }
    }
    positions_.Place(i, m);
  }
}

void ChordalStart::Impl::WritePoses(std::vector<double>* poses) const {
  poses->resize(graph_.poses.size());
  for (int i = 0; i < graph_.NumVertices(); ++i) {
    const Matrix3d& R = R_[static_cast<std::size_t>(i)];
    double* pose = poses->data() + static_cast<std::ptrdiff_t>(i) * graph_.PoseSize();
    std::copy_n(positions_.x(i), d_, pose);
    if (d_ == 3) {
      MatrixToQuaternion(R.data(), pose + 3);
    } else {
      pose[2] = std::atan2(R(1, 0), R(0, 0));
    }
  }
  // The first pose is what it was, to the last bit: projecting it would round.
  std::copy_n(graph_.PoseData(0), graph_.PoseSize(), poses->data());
}

Status ChordalStart::Impl::Compute(const std::vector<double>& weights, std::vector<double>* poses) {
  Status status = Check(weights);
  if (!status.ok()) {
    return status;
  }
  weights_ = weights;
  // Structures are those of all edges; with few zeros it is cheaper to carry them along.
  mostly_zero_ = static_cast<double>(std::count(weights.begin(), weights.end(), 0.0)) >
                 kSparseShare * static_cast<double>(weights.size());
  const Status singular =
      Status::Error(StatusCode::kSingular, "chordal start: the linear system could not be solved");
  // Rotations before positions, whose right-hand sides have them.
  MeasureRotations();
  if (!SolveRotations()) {
    return singular;
  }
  MeasurePositions();
  if (!positions_.Solve(graph_.PoseData(0), mostly_zero_)) {
    return singular;
  }
  WritePoses(poses);
  return Status::Ok();
}

ChordalStart::ChordalStart(const PoseGraph& graph, int num_threads)
    : impl_(std::make_unique<Impl>(graph, num_threads)) {
}
ChordalStart::~ChordalStart() = default;

Status ChordalStart::Compute(const std::vector<double>& weights, std::vector<double>* poses) {
  return impl_->Compute(weights, poses);
}

Status StartByChordalRelaxation(PoseGraph* graph, int num_threads) {
  return ChordalStart(*graph, num_threads).Compute({}, &graph->poses);
}

namespace {

// Whether edges and variables are those of the pose graph.
Status CheckGncStart(const PoseGraph& poses, const G2oGraph& ids,
                     const std::vector<int>& suspected_edges) {
  Status status = internal::CheckPoseGraph(poses);
  for (std::size_t k = 0; k < suspected_edges.size() && status.ok(); ++k) {
    const int edge = suspected_edges[k];
    if (edge < 0 || static_cast<std::size_t>(edge) >= poses.edges.size()) {
      status = Refuse("suspected_edges[" + std::to_string(k) + "] is " + std::to_string(edge) +
                      ", the pose graph has " + std::to_string(poses.edges.size()) + " edges");
    }
  }
  if (status.ok() && ids.poses.size() != poses.ids.size()) {
    status = Refuse("ids has " + std::to_string(ids.poses.size()) + " poses, the pose graph " +
                    std::to_string(poses.ids.size()) + " vertices");
  }
  return status;
}

// Whether the graph has the variables, of the size of a pose each.
Status CheckVariables(const FactorGraph& graph, const std::vector<VariableId>& variables,
                      int pose_size) {
  for (const VariableId id : variables) {
    if (!graph.HasVariable(id) || graph.AmbientSize(id) != pose_size) {
      return Refuse("variable " + std::to_string(id) + " is no pose of the graph");
    }
  }
  return Status::Ok();
}

}  // namespace

// What GNC calls before each of its solves has to outlive this function: the closure owns the
// chordal start and copies of the rest. Edges that are not suspected keep the weight 1.
GncStart ChordalGncStart(const PoseGraph& poses, const G2oGraph& ids,
                         std::vector<int> suspected_edges, int num_threads) {
  const auto chordal = std::make_shared<ChordalStart>(poses, num_threads);
  const int pose_size = poses.PoseSize();
  const Status fits_together = CheckGncStart(poses, ids, suspected_edges);
  return [chordal, pose_size, fits_together, variables = ids.poses,
          suspects = std::move(suspected_edges),
          of_edges = std::vector<double>(poses.edges.size(), 1.0)](
             const std::vector<double>& weights, FactorGraph* graph) mutable {
    if (!fits_together.ok()) {
      return fits_together;
    }
    if (weights.size() != suspects.size()) {
      return Refuse(std::to_string(weights.size()) + " weights for " +
                    std::to_string(suspects.size()) + " suspected edges");
    }
    Status status = CheckVariables(*graph, variables, pose_size);
    if (!status.ok()) {
      return status;
    }
    for (std::size_t k = 0; k < suspects.size(); ++k) {
      // of_edges lives on between calls, which is what makes the closure mutable; all suspects are
      // set each time.
      of_edges[static_cast<std::size_t>(suspects[k])] = weights[k];
    }
    std::vector<double> values;
    status = chordal->Compute(of_edges, &values);
    for (std::size_t i = 0; i < variables.size() && status.ok(); ++i) {
      graph->SetValues(variables[i], values.data() + static_cast<std::ptrdiff_t>(i) * pose_size);
    }
    return status;
  };
}

}  // namespace inceres
