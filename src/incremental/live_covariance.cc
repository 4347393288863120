#include "incremental/live_covariance.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

#include <Eigen/Core>

#include "base/option_rules.h"
#include "incremental/exact_covariance.h"
#include "incremental/factor_staleness.h"
#include "incremental/live_columns.h"
#include "linear/live_factor.h"
#include "problem/find_fault.h"

namespace inceres {

Status LiveCovarianceOptions::Validate() const {
  return internal::OptionRules("LiveCovarianceOptions")
      .Positive("tolerance", tolerance)
      .AtLeastOne("max_iterations", max_iterations)
      .status();
}

// Covariances from the factor that an Update has left (docs/algorithms.md, "From a live factor").
// With A = S + μD, D = diag(C), and V of few rows,
//
//     VᵀA⁻¹V = (L⁻¹V)ᵀ (L⁻¹V),   plus (P + λD)⁻¹ in the diagonal blocks of landmarks.
//
// Three sources: that factor as it is, a second one of S without damping, and conjugate gradients
// at the values of now with the first as their preconditioner. A Cholesky factor exists of a
// singular matrix too, thanks to damping or to rounding, so what has no variance is found by other
// means: the smallest eigenvalue λ of D^−½ S D^−½, of all frames together, and each variance
// against the one that damping alone would leave. The smallest eigenvalue also bounds what the
// damping hides: a share of at most μ / (λ + μ) of a variance.
//
// Nothing of the system changes. Constants have zeros in the result.
namespace internal {
namespace {

// Each costs a solve with the factor.
constexpr int kInverseIterations = 4;
// Where the landmarks' damping may be what holds that direction: the gauge, and others beside it.
constexpr int kMoreInverseIterations = 12;
// By how much the graph may grow before the weakest direction is looked for again.
constexpr double kGrowth = 1.1;
// Of a landmark: damping that takes more than this share of a variance outweighs what factors say.
constexpr double kMostDampingError = 0.5;
// A direction in which S has less than this share of the damping is open: rounding is what it has.
constexpr double kOpen = 1e-4;
// The same without damping, in units of diag(C), as CovarianceOptions::max_inflation has it.
constexpr double kNoCurvature = 1e-12;
// Of what holds the weakest direction: with more the landmarks' damping is all there is.
constexpr double kMostOfLandmarks = 0.9;
// From here on it is worth more iterations.
constexpr double kManyOfLandmarks = 0.1;
constexpr double kNoFactorHere = 1e-12;  // of a coordinate that no factor of the frame has

Status Singular(const std::string& message) {
  return Status::Error(StatusCode::kSingular, message);
}

Status NotDetermined(VariableId id, const char* why) {
  return Singular(VariableName(id) + " has no covariance: " + why);
}

constexpr const char* kFree =
    "the gauge is free, or what holds it is lost in the damping of the factor "
    "(CovarianceAccuracy::kExact)";

constexpr const char* kFewViews = "the landmark is not determined by its factors";

// Whether a covariance can be asked for: a constant's is zero, and of what no factor touches there
// is none. Landmarks outside S are undetermined.
Status CheckId(const LiveSource& source, VariableId id) {
  if (!source.graph.HasVariable(id)) {
    return Invalid(VariableName(id) + " does not exist");
  }
  if (source.graph.IsConstant(id)) {
    return Status::Ok();
  }
  const IncrementalSchur& schur = source.system.schur();
  const int frame = source.system.FrameOf(id), landmark = source.system.LandmarkOf(id);
  const bool is_touched =
      frame >= 0
          ? !schur.frames()[frame].factors.empty() || !schur.frames()[frame].landmarks.empty()
          : landmark >= 0 && !schur.landmarks()[landmark].factors.empty();
  if (!is_touched) {
    return Invalid(VariableName(id) + " has no covariance: no factor touches it");
  }
  return frame >= 0 || schur.IsInS(landmark) ? Status::Ok() : NotDetermined(id, kFewViews);
}

// The factor of S + μD that is used.
struct Inverse {
  LiveFactor factor;
  const UndampedFactor* undamped;  // if it is that of S, of which products may go around a few rows
  double mu;
  double open;  // a direction with a smaller eigenvalue has no information
};

// diag(C) of the frames that take part, mixed signs in units of its −½th power.
void MakeProbe(const IncrementalSchur& schur, const std::vector<int>& offsets, Eigen::VectorXd* D,
               Eigen::VectorXd* x) {
  std::uint32_t bits = 1;
  for (std::size_t row = 0; row + 1 < offsets.size(); ++row) {
    const IncrementalSchur::Frame& frame = schur.frames()[row];
    const bool takes_part = !frame.held && !(frame.factors.empty() && frame.landmarks.empty());
    for (int k = 0; k < frame.size && takes_part; ++k) {
      const int at = offsets[row] + k;
      (*D)[at] = std::max(schur.FrameDiagonal(static_cast<int>(row))[k], kNoFactorHere);
      // A linear congruential sequence, always the same: covariances have the same bits each time.
      bits = bits * 1664525u + 1013904223u;
      (*x)[at] = ((bits >> 31) != 0 ? 1.0 : -1.0) / std::sqrt((*D)[at]);
    }
  }
}

// Inverse iteration with (S + μD)⁻¹ D.
// θ = yᵀ(S + μD)y / yᵀDy of y = (S + μD)⁻¹ D x is a Rayleigh quotient of D^−½ (S + μD) D^−½, whose
// smallest eigenvalue is μ more than that of D^−½ S D^−½. S has the damping of the landmarks, so
// that it holds a free gauge too: which share of θ − μ that is tells the last x.
Status FindWeakest(const LiveSource& source, const Inverse& inverse,
                   const std::vector<int>& offsets) {
  const IncrementalSchur& schur = source.system.schur();
  Eigen::VectorXd D = Eigen::VectorXd::Zero(offsets.back());
  Eigen::VectorXd x = D, y = D;
  MakeProbe(schur, offsets, &D, &x);
  double theta = HUGE_VAL, of_landmarks = 0.0;
  int most = kInverseIterations;
  for (int i = 0; i < most && x.squaredNorm() > 0.0; ++i) {
    // xᵀDx = 1.
    x /= std::sqrt(x.dot(D.cwiseProduct(x)));
    const Eigen::VectorXd b = D.cwiseProduct(x);
    const Status solved = inverse.factor.Solve(offsets, b.data(), y.data());
    if (!solved.ok()) {
      return solved;
    }
    const double length = y.dot(D.cwiseProduct(y));
    theta = b.dot(y) / length;
    x = y;
    if (i + 1 == most) {
      of_landmarks = LandmarkDampingAlong(schur, x) / length;
      most = of_landmarks > kManyOfLandmarks * (theta - inverse.mu) ? kMoreInverseIterations : most;
    }
  }
  Eigen::Index largest = 0;
  x.cwiseAbs2().cwiseProduct(D).maxCoeff(&largest);
  // The row that has this scalar; offsets of free rows are those of the next one.
  const auto row = std::upper_bound(offsets.begin(), offsets.end(), static_cast<int>(largest)) -
                   offsets.begin() - 1;
  // θ ≥ μ but for rounding.
  *source.weakest = {std::max(0.0, theta - inverse.mu), of_landmarks, schur.frames()[row].id,
                     schur.structure().num_frames(), true};
  return Status::Ok();
}

// The eigenvalue is remembered: looking for it takes solves, and it changes little from Update to
// Update. What comes may be weaker, so it is looked for again once the graph has grown by a share.
bool KnowsWeakest(const LiveSource& source) {
  return source.weakest->is_known &&
         source.system.schur().structure().num_frames() <= kGrowth * source.weakest->num_frames;
}

Status CheckGauge(const LiveSource& source, const Inverse& inverse, const std::vector<int>& offsets,
                  double* damping_error) {
  const WeakestDirection& weakest = *source.weakest;
  if (!KnowsWeakest(source)) {
    const Status found = FindWeakest(source, inverse, offsets);
    if (!found.ok()) {
      return found;
    }
  }
  // 1/λ in place of 1/(λ + μ): the share that is missing of the largest variance.
  *damping_error = inverse.mu > 0.0 ? inverse.mu / (weakest.eigenvalue + inverse.mu) : 0.0;
  const bool is_held = weakest.eigenvalue > inverse.open &&
                       weakest.of_landmarks <= kMostOfLandmarks * weakest.eigenvalue;
  return is_held ? Status::Ok() : NotDetermined(weakest.variable, kFree);
}

// The largest share that the damping has in a variance of a landmark for known frames.
// λ P_ii times the variance of coordinate i, (P + λD)⁻¹_ii = Σ_k U_inv,ki²; 1 would be damping
// only.
double DampingShareOf(const IncrementalSchur& schur, int l) {
  const double *U_inv = schur.blocks().UInv(l), *P = schur.blocks().P(l);
  double share = 0.0;
  for (int i = 0; i < schur.landmarks()[l].size; ++i) {
    double variance = 0.0;
    for (int k = i; k < schur.landmarks()[l].size; ++k) {
      variance += U_inv[k * kQuad + i] * U_inv[k * kQuad + i];
    }
    share = std::max(share, schur.blocks().lambda(l) * P[i * kQuad + i] * variance);
  }
  return share;
}

// Of a landmark: whether the damping alone would nearly give its variance. Of a frame, which may
// have come since the weakest direction was looked for: the same, or rounding.
Status CheckVariances(const LiveSource& source, const Inverse& inverse, const LiveColumns& columns,
                      const std::vector<VariableId>& ids, const Eigen::MatrixXd& joint) {
  const IncrementalSchur& schur = source.system.schur();
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const int frame = source.system.FrameOf(ids[k]);
    if (frame < 0 && DampingShareOf(schur, source.system.LandmarkOf(ids[k])) > kMostDampingError) {
      return NotDetermined(ids[k], kFewViews);
    }
    for (int j = 0; frame >= 0 && j < schur.frames()[frame].size; ++j) {
      const int at = columns.offsets()[k] + j;
      // v D_jj (μ + open) < 1: a variance that damping alone would leave is 1 / (μ D_jj). Also
      // false of a NaN.
      if (!(joint(at, at) * schur.FrameDiagonal(frame)[j] * (inverse.mu + inverse.open) < 1.0)) {
        return NotDetermined(ids[k], kFree);
      }
    }
  }
  return Status::Ok();
}

// Variances are checked before the landmarks' own blocks are added, for those checks are of frames;
// landmarks have one of their own.
Status FromFactor(const LiveSource& source, const std::vector<VariableId>& ids,
                  const Inverse& inverse, FactorStaleness* staleness, Eigen::MatrixXd* joint) {
  const std::vector<int>& offsets = source.system.schur().offsets();
  const LiveColumns columns(source.system, ids);
  Status status = Status::Ok();
  joint->setZero(columns.offsets().back(), columns.offsets().back());
  // Landmarks that see no frame that moves have no columns: their own blocks are all there is.
  if (!columns.V().rows.empty()) {
    status = CheckGauge(source, inverse, offsets, &staleness->damping_error);
    status = !status.ok()                  ? status
             : inverse.undamped != nullptr ? inverse.undamped->Product(columns.V(), offsets, joint)
                                           : inverse.factor.Product(columns.V(), offsets, joint);
  }
  status = status.ok() ? CheckVariances(source, inverse, columns, ids, *joint) : status;
  columns.AddLandmarks(joint);
  return status;
}

// `whole`: nothing of S waits to be factored, as the weakest direction is looked for by solves.
Status Undamped(const LiveSource& source, const std::vector<VariableId>& ids, bool whole,
                FactorStaleness* staleness, Eigen::MatrixXd* joint) {
  Status status = Status::Ok();
  if (source.system.schur().size() > 0) {
    status =
        source.undamped->Follow(&source.system.schur(), whole, &staleness->num_factored_frames);
  }
  if (status.code == StatusCode::kSingular) {
    status.message.insert(
        0, "there is no covariance: the gauge is free, or a variable is not determined: ");
  }
  status =
      status.ok()
          ? FromFactor(source, ids,
                       {LiveFactor(source.undamped->tree()), source.undamped, 0.0, kNoCurvature},
                       staleness, joint)
          : status;
  return status.code == StatusCode::kUnavailable && !whole
             ? Undamped(source, ids, /*whole=*/true, staleness, joint)
             : status;
}

Status AsFactored(const LiveSource& source, const std::vector<VariableId>& ids,
                  const LiveCovarianceOptions& options, FactorStaleness* staleness,
                  Eigen::MatrixXd* joint) {
  const double mu = source.frames.factored_mu();
  // Of the damped S; it is asked for products and forgets nothing of its own solves.
  const LiveFactor factor(source.frames.solver());
  if (!factor.exists() && source.system.schur().size() > 0) {
    return Status::Error(StatusCode::kUnavailable,
                         "there is no factor to take covariances from: the reduced solver is "
                         "conjugate gradients or the user's (CovarianceAccuracy::kUndamped)");
  }
  // Rows of S that have changed since it was factored.
  staleness->num_changed_rows = source.system.schur().changes().num_unfactored();
  staleness->frame_damping = mu;
  if (options.accuracy == CovarianceAccuracy::kAsFactored) {
    // A direction in which S has less than 1e-4 of the damping is lost in it.
    return FromFactor(source, ids, {factor, nullptr, mu, kOpen * mu}, staleness, joint);
  }
  // All factors linearized anew at the values of now: nothing is stale there, but it takes
  // iterations.
  ExactCovariance exact(source.graph, source.system, factor);
  Status status = exact.Linearize();
  status =
      status.ok() ? exact.Compute(ids, options.tolerance, options.max_iterations, joint) : status;
  staleness->num_iterations = exact.num_iterations();
  return status;
}

// Lays out the result, zeros so far, and lists what moves.
// Each id once: with two, rows and columns of the result would be singular.
Status Begin(const LiveSource& source, const std::vector<VariableId>& ids,
             LiveCovariance* covariance, std::vector<VariableId>* moving) {
  covariance->offsets.assign(1, 0);
  for (std::size_t k = 0; k < ids.size(); ++k) {
    const Status checked = std::count(ids.begin(), ids.end(), ids[k]) == 1
                               ? CheckId(source, ids[k])
                               : Invalid(VariableName(ids[k]) + " is asked for twice");
    if (!checked.ok()) {
      return checked;
    }
    covariance->offsets.push_back(covariance->offsets.back() + source.graph.TangentSize(ids[k]));
    if (!source.graph.IsConstant(ids[k])) {
      moving->push_back(ids[k]);
    }
  }
  covariance->variables = ids;
  covariance->values.assign(static_cast<std::size_t>(covariance->size()) * covariance->size(), 0.0);
  return Status::Ok();
}

// The rows and columns of what moves.
// From the matrix of what moves into that of all that were asked for, row by row.
void Place(const LiveSource& source, const Eigen::MatrixXd& joint, LiveCovariance* covariance) {
  std::vector<int> places;
  for (std::size_t k = 0; k < covariance->variables.size(); ++k) {
    for (int j = covariance->offsets[k];
         j < covariance->offsets[k + 1] && !source.graph.IsConstant(covariance->variables[k]);
         ++j) {
      places.push_back(j);
    }
  }
  for (std::size_t i = 0; i < places.size(); ++i) {
    for (std::size_t j = 0; j < places.size(); ++j) {
      covariance->values[static_cast<std::size_t>(places[i]) * covariance->size() + places[j]] =
          joint(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j));
    }
  }
}

}  // namespace

Status ComputeLiveCovariance(const LiveSource& source, const std::vector<VariableId>& ids,
                             const LiveCovarianceOptions& options, LiveCovariance* covariance) {
  std::vector<VariableId> moving;
  Status status = Begin(source, ids, covariance, &moving);
  FactorStaleness staleness;
  if (status.ok() && !moving.empty()) {
    staleness.num_dirty_factors = source.system.NumDirtyFactors();
    for (const VariableId id : moving) {
      // Also where the covariance fails afterwards: it may be why.
      CountStaleness(source.system, source.frames.values(), id, &staleness);
    }
    Eigen::MatrixXd joint;
    status = options.accuracy == CovarianceAccuracy::kUndamped
                 ? Undamped(source, moving, !KnowsWeakest(source), &staleness, &joint)
                 : AsFactored(source, moving, options, &staleness, &joint);
    if (status.ok()) {
      Place(source, joint, covariance);
    }
  }
  if (!status.ok()) {
    // Nothing but the staleness is left of a failure.
    *covariance = LiveCovariance();
  }
  covariance->staleness = staleness;
  return status;
}

}  // namespace internal
}  // namespace inceres
