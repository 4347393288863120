#include "incremental/live_gauge.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>

#include <Eigen/Core>
#include <Eigen/Eigenvalues>

#include "base/sort_unique.h"
#include "incremental/live_columns.h"

namespace inceres::internal {

// Whether anything holds what covariances are asked of (docs/algorithms.md, "From a live factor").
// A Cholesky factor exists of a singular matrix too, thanks to damping or to rounding. So the
// smallest eigenvalue λ of D^−½ S D^−½, of all frames together, is looked for, and which share of
// it the landmarks' damping is, which S contains. It is remembered: looking for it takes solves,
// and it changes little from Update to Update. What comes may be weaker, so it is looked for again
// once the graph has grown by a share, and until then new frames are looked at by themselves: in a
// null vector of the whole the frames from before do not move, or they would have been free before.
namespace {

// Each costs a solve with the factor.
constexpr int kInverseIterations = 4;
// Where the landmarks' damping may be what holds that direction: the gauge, and others beside it.
constexpr int kMoreInverseIterations = 12;
// The largest share of that damping is found once it grows by less from one solve to the next.
constexpr double kSettled = 0.01;
// By how much the graph may grow before the weakest direction is looked for again.
constexpr double kGrowth = 1.1;
// So many new frames are looked at by a dense matrix.
constexpr int kMostNewFrames = 16;
constexpr double kNoFactorHere = 1e-12;  // of a coordinate that no factor of the frame has
// Of what holds the weakest direction: with more the landmarks' damping is all there is.
constexpr double kMostOfLandmarks = 0.9;
// From here on it is worth more iterations.
constexpr double kManyOfLandmarks = 0.1;

bool TakesPart(const IncrementalSchur::Frame& frame) {
  return frame.id >= 0 && !frame.held && !(frame.factors.empty() && frame.landmarks.empty());
}

// diag(C) of the frames that take part, mixed signs in units of its −½th power. Mixed signs, since
// a vector of ones may be orthogonal to what it is to find, by symmetry. Entries of frames that
// take no part stay zero in both.
void MakeProbe(const IncrementalSchur& schur, Eigen::VectorXd* D, Eigen::VectorXd* x) {
  std::uint32_t bits = 1;
  for (int row = 0; row < static_cast<int>(schur.frames().size()); ++row) {
    const IncrementalSchur::Frame& frame = schur.frames()[row];
    for (int k = 0; k < frame.size && TakesPart(frame); ++k) {
      const int at = schur.FrameOffset(row) + k;
      (*D)[at] = std::max(schur.FrameDiagonal(row)[k], kNoFactorHere);
      // A linear congruential sequence, always the same: covariances have the same bits each time.
      bits = bits * 1664525u + 1013904223u;
      (*x)[at] = ((bits >> 31) != 0 ? 1.0 : -1.0) / std::sqrt((*D)[at]);
    }
  }
}

void KeepWeights(const IncrementalSystem& system, WeakestDirection* weakest) {
  weakest->inverse_sqrt_w.assign(system.families().size(), {});
  for (const IncrementalFamily& family : system.families()) {
    std::vector<double>& roots = weakest->inverse_sqrt_w[static_cast<std::size_t>(family.id())];
    for (int i = 0; system.graph().HasLosses(family.id()) && i < family.num_places(); ++i) {
      roots.push_back(family.weighed().linearized(i) ? family.weighed().inverse_sqrt_w(i) : 0.0);
    }
  }
}

// Of factors that were there: w now over w then, where that was weight to speak of.
double LeastWeightKept(const IncrementalSystem& system, const WeakestDirection& weakest) {
  double least = 1.0;
  for (std::size_t family = 0; family < weakest.inverse_sqrt_w.size(); ++family) {
    const WeighedResiduals& weighed = system.families()[family].weighed();
    const std::vector<double>& roots = weakest.inverse_sqrt_w[family];
    for (std::size_t i = 0; i < roots.size(); ++i) {
      if (roots[i] > 0.0 && weighed.linearized(static_cast<int>(i))) {
        const double now = weighed.inverse_sqrt_w(static_cast<int>(i));
        least = std::min(least, now > 0.0 ? std::pow(roots[i] / now, 2) : 0.0);
      }
    }
  }
  return least;
}

// By row and id: a row that was given to another frame since counts as new.
void SeeAll(const IncrementalSchur& schur, WeakestDirection* weakest) {
  weakest->seen.resize(schur.frames().size());
  std::transform(schur.frames().begin(), schur.frames().end(), weakest->seen.begin(),
                 [](const IncrementalSchur::Frame& frame) { return frame.id; });
  weakest->num_seen = schur.structure().num_frames();
}

// They ascend, as the searches of ScaledBlock and the order of its scalars rely on.
std::vector<int> NewRows(const IncrementalSchur& schur, const WeakestDirection& weakest) {
  std::vector<int> rows;
  for (int row = 0; row < static_cast<int>(schur.frames().size()); ++row) {
    const bool is_seen = row < static_cast<int>(weakest.seen.size()) &&
                         weakest.seen[static_cast<std::size_t>(row)] == schur.frames()[row].id;
    if (!is_seen && TakesPart(schur.frames()[row])) {
      rows.push_back(row);
    }
  }
  return rows;
}

// D^−½ S D^−½ of a few rows; D^−½ of all rows, zero of the others. Scaled, since an eigenvalue of S
// itself depends on units: meters and radians would be held against each other. Below the diagonal
// only, which is what S stores and the eigenvalue solver reads; entries above it are not read. The
// frames from before are held by being left out.
Eigen::MatrixXd ScaledBlock(const IncrementalSchur& schur, const std::vector<int>& rows,
                            Eigen::VectorXd* inverse_roots) {
  std::vector<int> places;
  for (const int row : rows) {
    for (int k = 0; k < schur.frames()[row].size; ++k) {
      places.push_back(schur.FrameOffset(row) + k);
      (*inverse_roots)[places.back()] =
          1.0 / std::sqrt(std::max(schur.FrameDiagonal(row)[k], kNoFactorHere));
    }
  }
  Eigen::MatrixXd block = Eigen::MatrixXd::Zero(places.size(), places.size());
  for (int row : rows) {
    const auto first = [&](int of) {
      return std::lower_bound(places.begin(), places.end(), schur.FrameOffset(of)) - places.begin();
    };
    for (const SymmetricBlockRows::Entry& entry : schur.S().row(row)) {
      if (!std::binary_search(rows.begin(), rows.end(), entry.column)) {
        continue;
      }
      const int columns = schur.frames()[entry.column].size;
      using BlockOfRows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
      const Eigen::Map<const BlockOfRows, 0, Eigen::OuterStride<>> values(
          schur.S().values(entry.offset), schur.frames()[row].size, columns,
          Eigen::OuterStride<>((columns + kQuad - 1) / kQuad * kQuad));
      block.block(first(row), first(entry.column), values.rows(), columns) = values;
    }
  }
  for (Eigen::Index i = 0; i < block.rows(); ++i) {
    for (Eigen::Index j = 0; j <= i; ++j) {
      block(i, j) *= (*inverse_roots)[places[static_cast<std::size_t>(i)]] *
                     (*inverse_roots)[places[static_cast<std::size_t>(j)]];
    }
  }
  return block;
}

std::vector<std::int32_t> AllLandmarks(const IncrementalSchur& schur) {
  std::vector<std::int32_t> landmarks(schur.landmarks().size());
  std::iota(landmarks.begin(), landmarks.end(), 0);
  return landmarks;
}

// Each once.
std::vector<std::int32_t> LandmarksOf(const IncrementalSchur& schur, const std::vector<int>& rows) {
  std::vector<std::int32_t> landmarks;
  for (const int row : rows) {
    const auto& seen = schur.frames()[row].landmarks;
    landmarks.insert(landmarks.end(), seen.begin(), seen.end());
  }
  SortUnique(&landmarks);
  return landmarks;
}

// Δx, with S − Δ without the landmarks' damping; x moves no frame that other landmarks see.
Eigen::VectorXd DampingTimes(const IncrementalSchur& schur,
                             const std::vector<std::int32_t>& landmarks, const Eigen::VectorXd& x) {
  Eigen::VectorXd product = Eigen::VectorXd::Zero(x.size());
  std::vector<BlockRow> rows;
  for (const std::int32_t landmark : landmarks) {
    AddLandmarkDamping(schur, landmark, x, &rows, &product);
  }
  return product;
}

// The largest xᵀΔx / xᵀSx by power iteration with S⁻¹Δ, from x on. Without Δ the inverse of S is at
// most 1 / (1 − share) times as large, in every direction. The quotient is that of the pencil (Δ,
// S), whose largest eigenvalue is at most 1, for S − Δ is what the landmarks' factors leave and has
// no negative direction. Each iteration costs a solve with the factor of S + μD and a pass over the
// landmarks; μ is taken off yᵀ(S + μD)y again, so the share is one of S. The result is a lower
// bound that grows, hence the end once it grows little. Rounding may make the quotient larger than
// 1 or the curvature zero: then all of it is damping.
Status FindDampingShare(const IncrementalSchur& schur, const LiveFactor& factor, double mu,
                        const Eigen::VectorXd& D, const Eigen::VectorXd& x, double* share) {
  const std::vector<std::int32_t> landmarks = AllLandmarks(schur);
  Eigen::VectorXd b = DampingTimes(schur, landmarks, x), y = b;
  *share = 0.0;
  double gained = HUGE_VAL;
  for (int i = 0; i < kMoreInverseIterations && gained > kSettled * *share; ++i) {
    const double length = b.norm();
    if (!(length > 0.0)) {
      break;
    }
    b /= length;
    const Status solved = factor.Solve(schur.offsets(), b.data(), y.data());
    if (!solved.ok()) {
      return solved;
    }
    // yᵀSy
    const double curvature = b.dot(y) - mu * y.dot(D.cwiseProduct(y));
    b = DampingTimes(schur, landmarks, y);
    const double quotient = curvature > 0.0 ? std::min(b.dot(y) / curvature, 1.0) : 1.0;
    gained = quotient - *share;
    *share = std::max(*share, quotient);
  }
  return Status::Ok();
}

// Of a vector packed as S is: the frame with its largest entry, in units of D^−½.
VariableId LargestShare(const IncrementalSchur& schur, const Eigen::VectorXd& squares) {
  Eigen::Index largest = 0;
  squares.maxCoeff(&largest);
  // The row that has this scalar; offsets of free rows are those of the next one.
  const auto row =
      std::upper_bound(schur.offsets().begin(), schur.offsets().end(), static_cast<int>(largest)) -
      schur.offsets().begin() - 1;
  return schur.frames()[static_cast<std::size_t>(row)].id;
}

}  // namespace

// Without landmarks no damping is hidden in S, and what is new need not be looked at by itself.
// With them a graph must not have got more new frames than a dense matrix is for, and μ must not
// have fallen: what a larger μ was found with may have been μ's doing. A loss that takes a factor's
// weight takes as much of H as removing it does, and S keeps at least the least share of it. A
// gauge that was free may be held by what has come.
bool IsStillKnown(const WeakestDirection& weakest, const IncrementalSystem& system, double mu,
                  double open) {
  const IncrementalSchur& schur = system.schur();
  const int num_frames = schur.structure().num_frames();
  return weakest.is_known && num_frames <= kGrowth * weakest.num_frames &&
         (schur.structure().num_landmarks() == 0 ||
          (num_frames <= weakest.num_seen + kMostNewFrames && weakest.mu <= mu)) &&
         IsHeld(weakest, open) && LeastWeightKept(system, weakest) * weakest.eigenvalue > open;
}

// θ = yᵀ(S + μD)y / yᵀDy of y = (S + μD)⁻¹ D x is a Rayleigh quotient of D^−½ (S + μD) D^−½, whose
// smallest eigenvalue is μ more than that of D^−½ S D^−½. Four iterations tell an eigenvalue that
// is smaller by far than the next ones, as that of a free gauge is. Where several are alike, as the
// seven of a free gauge, the quotient is small whichever combination of them y is. Where the
// landmarks' damping has more than a tenth of what holds the direction it takes more iterations,
// for the gauge and others beside it are then alike. But for rounding θ − μ is never below the
// eigenvalue, so a direction that is found to be weak is one.
Status FindWeakest(const IncrementalSystem& system, const LiveFactor& factor, double mu,
                   WeakestDirection* weakest) {
  const IncrementalSchur& schur = system.schur();
  Eigen::VectorXd D = Eigen::VectorXd::Zero(schur.size());
  Eigen::VectorXd x = D, y = D;
  MakeProbe(schur, &D, &x);
  double theta = HUGE_VAL, of_landmarks = 0.0;
  int most = kInverseIterations;
  for (int i = 0; i < most && x.squaredNorm() > 0.0; ++i) {
    // xᵀDx = 1.
    x /= std::sqrt(x.dot(D.cwiseProduct(x)));
    const Eigen::VectorXd b = D.cwiseProduct(x);
    const Status solved = factor.Solve(schur.offsets(), b.data(), y.data());
    if (!solved.ok()) {
      return solved;
    }
    const double length = y.dot(D.cwiseProduct(y));
    theta = b.dot(y) / length;
    x = y;
    if (i + 1 == most) {
      of_landmarks = x.dot(DampingTimes(schur, AllLandmarks(schur), x)) / length;
      most = of_landmarks > kManyOfLandmarks * (theta - mu) ? kMoreInverseIterations : most;
    }
  }
  // θ ≥ μ but for rounding.
  weakest->eigenvalue = std::max(0.0, theta - mu);
  weakest->of_landmarks = of_landmarks;
  weakest->mu = mu;
  weakest->variable = LargestShare(schur, x.cwiseAbs2().cwiseProduct(D));
  weakest->num_frames = schur.structure().num_frames();
  SeeAll(schur, weakest);
  KeepWeights(system, weakest);
  const Status status = FindDampingShare(schur, factor, mu, D, x, &weakest->damping_share);
  weakest->is_known = status.ok();
  return status;
}

bool IsHeld(const WeakestDirection& weakest, double open) {
  return weakest.eigenvalue > open && weakest.of_landmarks <= kMostOfLandmarks * weakest.eigenvalue;
}

// Without landmarks the variances of new rows tell as much. Cost: the cube of the scalars of the
// new frames, of which IsStillKnown allows few, and their landmarks. The smallest eigenvector v of
// the block stands in units of D^½; x = D^−½ v is what the landmarks' damping is asked of. What it
// has of xᵀSx joins the largest share known, for the covariances that are given out from now on
// concern the new frames, too.
VariableId FindFreeNewFrame(const IncrementalSchur& schur, double open, WeakestDirection* weakest) {
  if (schur.structure().num_landmarks() == 0 ||
      schur.structure().num_frames() == weakest->num_seen) {
    return -1;
  }
  const std::vector<int> rows = NewRows(schur, *weakest);
  if (!rows.empty()) {
    Eigen::VectorXd inverse_roots = Eigen::VectorXd::Zero(schur.size());
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(
        ScaledBlock(schur, rows, &inverse_roots));  // of the lower triangle
    Eigen::VectorXd squares = Eigen::VectorXd::Zero(schur.size());
    Eigen::VectorXd x = squares;
    Eigen::Index k = 0;
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      if (inverse_roots[i] > 0.0) {
        squares[i] = std::pow(solver.eigenvectors()(k, 0), 2);
        x[i] = solver.eigenvectors()(k++, 0) * inverse_roots[i];
      }
    }
    WeakestDirection among_new;
    among_new.eigenvalue = std::max(0.0, solver.eigenvalues()[0]);
    among_new.of_landmarks = x.dot(DampingTimes(schur, LandmarksOf(schur, rows), x));
    if (!IsHeld(among_new, open)) {
      return LargestShare(schur, squares);
    }
    weakest->damping_share =
        std::max(weakest->damping_share, among_new.of_landmarks / among_new.eigenvalue);
  }
  SeeAll(schur, weakest);
  return -1;
}

}  // namespace inceres::internal
