#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "inceres/io/g2o.h"

#ifdef INCERES_HAVE_SPECTRA

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <Spectra/SymEigsSolver.h>

#include "inceres/factors/pose_prior.h"
#include "inceres/io/g2o_graph.h"
#include "inceres/io/pose_graph_start.h"
#include "inceres/problem/rotation.h"
#include "inceres/solver/solver.h"
#include "io/pose_graph.h"

// A lower bound of a pose graph's chordal cost, by Lagrangian duality as in SE-Sync (Rosen,
// Carlone, Bandeira & Leonard, IJRR 2019; docs/pose_graphs.md, "How good can it be"). With X = [p_1
// R_1 p_2 R_2 …], of d rows, the cost is the quadratic form
//
//     f = tr(X M Xᵀ),   subject to R_iᵀ R_i = I.
//
// At a stationary point the multipliers are Λ_i = sym((M Xᵀ)_i R_i), and f there is tr Λ. For any
// poses f = tr Λ + tr(X (M − Λ) Xᵀ), whatever symmetric Λ_i are, whose last term is negative only
// as far as M − Λ has negative eigenvalues, while the rows of all rotations have the squared norm
// n d together: f ≥ tr Λ − n d σ for each σ such that M − Λ + σ diag(0, I) is positive definite.
//
// So the bound rests on nothing that an iteration has left. It takes tr Λ, which holds for the Λ at
// hand, and not f_found, which is tr Λ only as far as the gradient is zero; and a σ that was really
// factored so, and not the eigenvalue that Lanczos found. A solve or an eigenvalue that has not
// converged makes the bound worse but not wrong. What is left is the rounding of sums and of the
// factorization, of the order of 1e-16 of κ for each entry. What is delicate is the size of σ: of a
// global minimum the least eigenvalue is zero but for rounding, since the rows of X themselves are
// in the null space of M − Λ; so everything is relative to the largest κ.

namespace inceres {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using SparseMatrix = Eigen::SparseMatrix<double>;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// An edge of f: from, to, R_ij and p_ab of d rows, κ and τ.
struct ChordalEdge {
  int i, j;
  MatrixXd R;
  VectorXd p;
  double kappa, tau;
};

// Of a pose or a measurement, which are laid out alike.
MatrixXd RotationOf(int dimension, const double* pose) {
  if (dimension == 3) {
    RowMajor3 R;
    QuaternionToMatrix(pose + 3, R.data());
    return R;
  }
  MatrixXd R(2, 2);
  R << std::cos(pose[2]), -std::sin(pose[2]), std::sin(pose[2]), std::cos(pose[2]);
  return R;
}

// Each edge's information is replaced by one that is isotropic in position and in rotation:
// SE-Sync's κ = 3/(2 tr Σ_R), τ = d/tr Σ_p, and κ = 1/(2σ²) of an angle. size − d is 3 or 1, the
// number of rotational degrees of freedom, so one formula serves both.
Status MakeEdges(const PoseGraph& graph, std::vector<ChordalEdge>* edges) {
  const Index d = graph.dimension, size = graph.TangentSize();
  for (std::size_t k = 0; k < graph.edges.size(); ++k) {
    const PoseGraphEdge& edge = graph.edges[k];
    const MatrixXd information = Eigen::Map<const MatrixXd>(edge.information.data(), size, size);
    const Eigen::LLT<MatrixXd> factor(information);
    if (factor.info() != Eigen::Success) {
      return Status::Error(
          StatusCode::kInvalidArgument,
          "chordal bound: the information of edge " + std::to_string(k) + ", from vertex " +
              std::to_string(graph.ids[static_cast<std::size_t>(edge.from)]) + " to " +
              std::to_string(graph.ids[static_cast<std::size_t>(edge.to)]) +
              ", is not positive definite");
    }
    // The file's order has the position first. A mapped symmetric matrix is the same by rows and by
    // columns.
    const double turn = information.bottomRightCorner(size - d, size - d).inverse().trace();
    const double shift = information.topLeftCorner(d, d).inverse().trace();
    edges->push_back({edge.from, edge.to, RotationOf(graph.dimension, edge.measurement.data()),
                      Eigen::Map<const VectorXd>(edge.measurement.data(), d),
                      static_cast<double>(size - d) / (2.0 * turn),
                      static_cast<double>(d) / shift});
  }
  return Status::Ok();
}

// Planar poses as spatial ones in the plane z = 0, where chords are sines of half angles.
PoseGraph AllInSpace(const PoseGraph& graph) {
  PoseGraph spatial = graph;
  if (graph.dimension == 3) {
    return spatial;
  }
  spatial.dimension = 3;
  spatial.poses.clear();
  for (int i = 0; i < graph.NumVertices(); ++i) {
    const std::array<double, 7> pose = internal::InSpace(graph.PoseData(i));
    spatial.poses.insert(spatial.poses.end(), pose.begin(), pose.end());
  }
  for (PoseGraphEdge& edge : spatial.edges) {
    edge.measurement = internal::InSpace(edge.measurement.data());
  }
  return spatial;
}

// The minimum of f near the graph's poses. f = ½ Σ ‖U e‖² with g2o's error, for ‖R_j − R_i R_ij‖²
// = 8 ‖ε‖².
// U is diagonal, and ½‖U e‖² has τ and 8 κ where the diagonal of the information has 2 τ and 16 κ;
// the position's weight does not care in which axes its error stands.
Status MinimizeChordal(const PoseGraph& graph, const std::vector<ChordalEdge>& edges,
                       PoseGraph* minimum) {
  *minimum = AllInSpace(graph);
  for (std::size_t k = 0; k < edges.size(); ++k) {
    minimum->edges[k].information.fill(0.0);
    for (std::size_t r = 0; r < 6; ++r) {
      minimum->edges[k].information[7 * r] = r < 3 ? 2.0 * edges[k].tau : 16.0 * edges[k].kappa;
    }
  }
  // The certificate takes the first position out, and a common rotation changes nothing: to hold
  // what FIX lines name would.
  minimum->fixed = {0};
  PoseGraphOptions options;
  options.convention = PoseErrorConvention::kG2o;
  FactorGraph factors;
  G2oGraph ids;
  Status status = AddPoseGraph(*minimum, options, &factors, &ids);
  if (!status.ok()) {
    return status;
  }
  SolverOptions solver;
  solver.strategy = TrustRegionStrategyKind::kDogleg;
  solver.max_num_iterations = 200;
  // As far as it goes: Λ is defined at a stationary point, and what is left of the gradient may
  // make M − Λ indefinite.
  solver.function_tolerance = solver.parameter_tolerance = solver.gradient_tolerance = 1e-15;
  const Summary summary = Solve(solver, &factors);
  if (!summary.IsSolutionUsable()) {
    return Status::Error(StatusCode::kSingular, "chordal bound: " + summary.message);
  }
  for (int i = 0; i < minimum->NumVertices(); ++i) {
    std::copy_n(factors.Values(ids.poses[static_cast<std::size_t>(i)]), 7, minimum->PoseData(i));
  }
  return status;
}

// The quadratic form M of f in the rows of X = [p_1 R_1 p_2 R_2 …], one block of d + 1 columns a
// vertex: f = tr(X M Xᵀ).
class ChordalForm {
 public:
  ChordalForm(int dimension, int num_vertices, const std::vector<ChordalEdge>& edges)
      : d_(dimension), n_(num_vertices) {
    std::vector<Eigen::Triplet<double>> entries;
    for (const ChordalEdge& edge : edges) {
      // p_j − p_i − R_i p_ij = X a, and R_j − R_i R_ij = X B, column by column.
      // In the order p_i, R_i, p_j, R_j. The first column is a, the others are B.
      MatrixXd a = MatrixXd::Zero(2 * (d_ + 1), d_ + 1);
      a(d_ + 1, 0) = 1.0;
      a(0, 0) = -1.0;
      a.block(1, 0, d_, 1) = -edge.p;
      a.block(d_ + 2, 1, d_, d_).setIdentity();
      a.block(1, 1, d_, d_) = -edge.R;
      VectorXd weights = VectorXd::Constant(d_ + 1, edge.kappa);
      weights[0] = edge.tau;
      // f of the edge = τ ‖X a‖² + κ ‖X B‖²_F = tr(X A W Aᵀ Xᵀ) with A = [a B].
      AddBlock(edge, a * weights.asDiagonal() * a.transpose(), &entries);
    }
    M_.resize(n_ * (d_ + 1), n_ * (d_ + 1));
    // Sums what several edges have at one place.
    M_.setFromTriplets(entries.begin(), entries.end());
  }

  // f, tr Λ, and M − Λ without the first vertex's position: Λ_i is the symmetric part of (M Xᵀ)_i
  // R_i. Positions have no multipliers: nothing constrains them. Row and column 0 are left out, for
  // moving everything costs nothing, and M would be singular whatever the rotations.
  double Subtract(const MatrixXd& X, double* trace, SparseMatrix* S) const {
    const MatrixXd image = M_ * X.transpose();
    *trace = 0.0;
    std::vector<Eigen::Triplet<double>> entries;
    for (Index i = 0; i < n_; ++i) {
      const Index first = i * (d_ + 1) + 1;
      const MatrixXd product = image.middleRows(first, d_) * X.middleCols(first, d_);
      const MatrixXd multiplier = 0.5 * (product + product.transpose());
      *trace += multiplier.trace();
      for (Index r = 0; r < d_; ++r) {
        for (Index c = 0; c < d_; ++c) {
          entries.emplace_back(first + r, first + c, -multiplier(r, c));
        }
      }
    }
    SparseMatrix minus_multipliers(M_.rows(), M_.cols());
    minus_multipliers.setFromTriplets(entries.begin(), entries.end());
    const SparseMatrix full = M_ + minus_multipliers;
    *S = full.bottomRightCorner(full.rows() - 1, full.cols() - 1);
    return (X * image).trace();
  }

 private:
  void AddBlock(const ChordalEdge& edge, const MatrixXd& block,
                std::vector<Eigen::Triplet<double>>* entries) const {
    // Row of X's columns for a row of the block: the first d + 1 are those of i.
    const auto place = [&edge, this](Index k) {
      return k <= d_ ? edge.i * (d_ + 1) + k : edge.j * (d_ + 1) + k - (d_ + 1);
    };
    for (Index r = 0; r < block.rows(); ++r) {
      for (Index c = 0; c < block.cols(); ++c) {
        if (block(r, c) != 0.0) {
          entries->emplace_back(place(r), place(c), block(r, c));
        }
      }
    }
  }

  const Index d_, n_;
  SparseMatrix M_;
};

// (S_red + σI)⁻¹ of the rotations, the positions eliminated: a solve with S + σ diag(0, I).
// What Spectra wants of an operator: rows(), cols(), perform_op and Scalar. The inverse of the
// Schur complement of the rotations is a block of the inverse of the whole, so neither the
// complement, which is dense, nor the positions' block is ever formed; S_ stays sparse.
class InverseOfShifted {
 public:
  using Scalar = double;

  // Columns of S are those of M but the first: its column k is column k + 1 of M, and positions are
  // at multiples of d + 1.
  InverseOfShifted(const SparseMatrix& S, Index dimension) : S_(S) {
    for (Index k = 0; k < S.rows(); ++k) {
      if ((k + 1) % (dimension + 1) != 0) {
        rotations_.push_back(k);
      }
    }
    factor_.analyzePattern(S_);
  }

  // Whether S + σ diag(0, I) is positive definite.
  // A numerical factorization only; the pattern is that of S_, whose diagonal has entries for all
  // rotations by their multipliers. LDLᵀ does not stop at a negative pivot, so D is looked at: its
  // signs are those of the eigenvalues.
  bool Shift(double sigma) {
    SparseMatrix shifted = S_;
    for (const Index k : rotations_) {
      shifted.coeffRef(k, k) += sigma;
    }
    factor_.factorize(shifted);
    return factor_.info() == Eigen::Success && factor_.vectorD().minCoeff() > 0.0;
  }

  Index rows() const { return static_cast<Index>(rotations_.size()); }
  Index cols() const { return rows(); }
  // With zeros for the positions in b, and the positions of the result left out.
  void perform_op(const double* x, double* y) const {
    VectorXd b = VectorXd::Zero(S_.rows());
    for (std::size_t k = 0; k < rotations_.size(); ++k) {
      b[rotations_[k]] = x[k];
    }
    const VectorXd solved = factor_.solve(b);
    for (std::size_t k = 0; k < rotations_.size(); ++k) {
      y[k] = solved[rotations_[k]];
    }
  }

 private:
  SparseMatrix S_;
  std::vector<Index> rotations_;
  Eigen::SimplicialLDLT<SparseMatrix> factor_;
};

// λ_min(S_red), and the least shift known that makes it positive definite.
// The largest eigenvalue of the inverse is 1/(λ_min + σ): the nearer σ is to −λ_min, the better it
// stands apart from the others, and the faster Lanczos finds it. So σ starts small and grows only
// until the factorization is definite.
Status SmallestEigenvalue(InverseOfShifted* inverse, double scale, double* smallest,
                          double* shift) {
  double sigma = 1e-7 * scale;
  while (!inverse->Shift(sigma)) {
    sigma *= 10.0;
    // Of a graph without edges the scale is zero, and no shift grows.
    if (sigma >= 1e6 * scale) {
      return Status::Error(StatusCode::kSingular,
                           "chordal bound: the certificate matrix cannot be factored");
    }
  }
  *shift = sigma;
  const Index wanted = 1, subspace = std::min<Index>(40, inverse->rows());
  Spectra::SymEigsSolver<InverseOfShifted> eigen(*inverse, wanted, subspace);
  // From a start vector that Spectra makes with a seed of its own: the same in every run.
  eigen.init();
  eigen.compute(Spectra::SortRule::LargestAlge, 300, 1e-8);
  if (eigen.info() != Spectra::CompInfo::Successful) {
    return Status::Error(StatusCode::kSingular,
                         "chordal bound: the smallest eigenvalue was not found");
  }
  // A difference of numbers of the size of σ: exact to a small part of σ, which is 1e-7 of κ at
  // best.
  *smallest = 1.0 / eigen.eigenvalues()[0] - sigma;
  // The shift as small as the eigenvalue says, if it can be factored so.
  const double tight = std::max(0.0, -*smallest) * (1.0 + 1e-6) + 1e-10 * scale;
  *shift = tight < sigma && inverse->Shift(tight) ? tight : sigma;
  return Status::Ok();
}

// ‖R_a − R_b‖_F = √8 sin(θ/2) in the plane and in space.
double LargestAngle(int dimension, const PoseGraph& a, const MatrixXd& X) {
  double largest = 0.0;
  for (int i = 0; i < a.NumVertices(); ++i) {
    const MatrixXd R = X.middleCols(i * (dimension + 1) + 1, dimension);
    const double chord = (RotationOf(dimension, a.PoseData(i)) - R).norm() / std::sqrt(8.0);
    largest = std::max(largest, 2.0 * std::asin(std::min(1.0, chord)));
  }
  return largest;
}

}  // namespace

bool HasChordalBound() {
  return true;
}

// Sizes and indices, weights of the edges, connectedness, minimum, certificate, in this order. A
// graph in several pieces would have a translation for each: only one is taken out of S, which
// would be singular for any rotations.
Status BoundChordalCost(const PoseGraph& graph, ChordalBound* bound) {
  std::vector<ChordalEdge> edges;
  Status status = internal::CheckPoseGraph(graph);
  status = status.ok() ? MakeEdges(graph, &edges) : status;
  PoseGraph placed = graph, minimum;
  status = status.ok() ? StartAlongSpanningTree(&placed) : status;  // that it hangs together
  status = status.ok() ? MinimizeChordal(graph, edges, &minimum) : status;
  if (!status.ok()) {
    return status;
  }
  const int d = graph.dimension, n = graph.NumVertices();
  // The minimum is in space even of a planar graph; its upper left block is the planar rotation.
  MatrixXd X(d, n * (d + 1));
  for (int i = 0; i < n; ++i) {
    X.col(i * (d + 1)) = Eigen::Map<const VectorXd>(minimum.PoseData(i), d);
    X.middleCols(i * (d + 1) + 1, d) = RotationOf(3, minimum.PoseData(i)).topLeftCorner(d, d);
  }
  SparseMatrix S;
  ChordalBound found;
  double scale = 0.0, shift = 0.0, trace = 0.0;
  found.cost = ChordalForm(d, n, edges).Subtract(X, &trace, &S);
  // The largest κ is the unit of the eigenvalues.
  for (const ChordalEdge& edge : edges) {
    scale = std::max(scale, edge.kappa);
  }
  InverseOfShifted inverse(S, d);
  status = SmallestEigenvalue(&inverse, scale, &found.smallest_eigenvalue, &shift);
  if (status.ok()) {
    // f is a sum of squares: a bound below zero says nothing.
    found.lower_bound = std::max(0.0, std::min(trace - n * d * shift, found.cost));
    found.gap = found.cost > 0.0 ? (found.cost - found.lower_bound) / found.cost : 0.0;
    found.largest_angle = LargestAngle(d, graph, X);
    *bound = found;
  }
  return status;
}

}  // namespace inceres

#else

namespace inceres {

bool HasChordalBound() {
  return false;
}

Status BoundChordalCost(const PoseGraph& /*graph*/, ChordalBound* /*bound*/) {
  return Status::Error(StatusCode::kUnavailable,
                       "chordal bound: this build was configured without Spectra (Debian: "
                       "libspectra-dev)");
}

}  // namespace inceres

#endif
