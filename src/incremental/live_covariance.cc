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
#include "incremental/live_gauge.h"
#include "linear/live_factor.h"
#include "linear/small_cholesky.h"
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
// means: the smallest eigenvalue λ of D^−½ S D^−½, of all frames together (live_gauge.cc), and each
// variance against the one that damping alone would leave. The smallest eigenvalue also bounds what
// the damping of frames hides: a share of at most μ / (λ + μ) of a variance. That of landmarks
// hides at most the largest share that it has of S, and, of a landmark's variance, that of its own
// block.
//
// Nothing of the system changes. Constants have zeros in the result.
namespace internal {
namespace {

// Of a landmark: damping that takes more than this share of a variance outweighs what factors say.
constexpr double kMostDampingError = 0.5;
// A direction in which S has less than this share of the damping is open: rounding is what it has.
constexpr double kOpen = 1e-4;
// The same without damping, in units of diag(C), as CovarianceOptions::max_inflation has it.
constexpr double kNoCurvature = 1e-12;

Status NotDetermined(VariableId id, const char* why) {
  return Status::Error(StatusCode::kSingular, VariableName(id) + " has no covariance: " + why);
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

// By the weakest direction, which is known: of all frames, and of those that have come since.
Status CheckHeld(const LiveSource& source, double open) {
  if (!IsHeld(*source.weakest, open)) {
    return NotDetermined(source.weakest->variable, kFree);
  }
  const VariableId free = FindFreeNewFrame(source.system.schur(), open, source.weakest);
  return free < 0 ? Status::Ok() : NotDetermined(free, kFree);
}

Status CheckGauge(const LiveSource& source, const Inverse& inverse) {
  const IncrementalSystem& system = source.system;
  const Status found = IsStillKnown(*source.weakest, system, inverse.mu, inverse.open)
                           ? Status::Ok()
                           : FindWeakest(system, inverse.factor, inverse.mu, source.weakest);
  return found.ok() ? CheckHeld(source, inverse.open) : found;
}

// By which share the damping, μ of frames and that of landmarks, lowers a variance at most.
// S_d + μD is at most (λ + μ) / λ times S_d, and that 1 / (1 − θ) times S. A landmark has its own
// damping besides: (xᵀΔx)^½ + (yᵀΛy)^½, squared, is at most θ + θ_l of what x and y cost together.
double DampingError(const LiveSource& source, const std::vector<VariableId>& ids, bool any_rows,
                    double mu) {
  double share = any_rows ? source.weakest->damping_share : 0.0;
  for (const VariableId id : ids) {
    if (source.system.FrameOf(id) < 0) {
      share = std::max(
          share, (any_rows ? source.weakest->damping_share : 0.0) +
                     LargestDampingShare(source.system.schur(), source.system.LandmarkOf(id)));
    }
  }
  const double lambda = source.weakest->eigenvalue;
  const double kept = any_rows && mu > 0.0 ? lambda / (lambda + mu) : 1.0;
  return 1.0 - kept * std::max(0.0, 1.0 - share);
}

// The largest share that the damping has in a variance of a landmark for known frames.
// λ D_ii times the variance of coordinate i, (P + λD)⁻¹_ii; 1 would be damping only.
double DampingShareOf(const IncrementalSchur& schur, int l) {
  const double* U_inv = schur.blocks().UInv(l);
  const int size = schur.landmarks()[l].size;
  double share = 0.0;
  for (int i = 0; i < size; ++i) {
    share = std::max(share, schur.blocks().lambda(l) * schur.blocks().D(l, i) *
                                VarianceOfCoordinate(size, U_inv, i));
  }
  return share;
}

// Of a frame whose variances begin at this place: whether they are those that damping alone, or
// rounding, would leave. It may have come since the weakest direction was looked for. `floor`:
// μ and what counts as open.
Status CheckFrame(const LiveSource& source, VariableId id, int begin, double floor,
                  const Eigen::MatrixXd& joint) {
  const IncrementalSchur& schur = source.system.schur();
  const int row = source.system.FrameOf(id);
  for (int j = 0; j < schur.frames()[row].size; ++j) {
    // v D_jj (μ + open) < 1: a variance that damping alone would leave is 1 / (μ D_jj). Also
    // false of a NaN.
    if (!(joint(begin + j, begin + j) * schur.FrameDiagonal(row)[j] * floor < 1.0)) {
      return NotDetermined(id, kFree);
    }
  }
  return Status::Ok();
}

// Of a landmark: whether the damping alone would nearly give its variance.
Status CheckVariances(const LiveSource& source, const Inverse& inverse, const LiveColumns& columns,
                      const std::vector<VariableId>& ids, const Eigen::MatrixXd& joint) {
  const IncrementalSchur& schur = source.system.schur();
  for (std::size_t k = 0; k < ids.size(); ++k) {
    if (source.system.FrameOf(ids[k]) < 0) {
      if (DampingShareOf(schur, source.system.LandmarkOf(ids[k])) > kMostDampingError) {
        return NotDetermined(ids[k], kFewViews);
      }
      continue;
    }
    const Status checked =
        CheckFrame(source, ids[k], columns.offsets()[k], inverse.mu + inverse.open, joint);
    if (!checked.ok()) {
      return checked;
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
    status = CheckGauge(source, inverse);
    status = !status.ok()                  ? status
             : inverse.undamped != nullptr ? inverse.undamped->Product(columns.V(), offsets, joint)
                                           : inverse.factor.Product(columns.V(), offsets, joint);
  }
  status = status.ok() ? CheckVariances(source, inverse, columns, ids, *joint) : status;
  if (status.ok()) {
    columns.AddLandmarks(joint);
    staleness->damping_error = DampingError(source, ids, !columns.V().rows.empty(), inverse.mu);
  }
  return status;
}

// `whole`: nothing of S waits to be factored, as the weakest direction is looked for by solves.
Status FollowUndamped(const LiveSource& source, const std::vector<VariableId>& ids, bool whole,
                      FactorStaleness* staleness, Eigen::MatrixXd* joint) {
  Status status = Status::Ok();
  if (source.system.schur().size() > 0) {
    status = source.undamped->Follow(source.system.schur(), whole, &staleness->num_factored_frames);
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
             ? FollowUndamped(source, ids, /*whole=*/true, staleness, joint)
             : status;
}

// One frame is often the newest, whose marginal may be known without a factor.
Status Undamped(const LiveSource& source, const std::vector<VariableId>& ids,
                FactorStaleness* staleness, Eigen::MatrixXd* joint) {
  UndampedFactor& undamped = *source.undamped;
  const IncrementalSchur& schur = source.system.schur();
  undamped.NoteChanges(&source.system.schur());
  const int row = ids.size() == 1 ? source.system.FrameOf(ids[0]) : -1;
  const bool knows_weakest = IsStillKnown(*source.weakest, source.system, /*mu=*/0.0, kNoCurvature);
  if (row >= 0 && knows_weakest && undamped.KnowsMarginalOf(row)) {
    *joint = undamped.marginal();
    const Status held = CheckHeld(source, kNoCurvature);
    staleness->damping_error = DampingError(source, ids, /*any_rows=*/true, /*mu=*/0.0);
    return held.ok() ? CheckFrame(source, ids[0], 0, kNoCurvature, *joint) : held;
  }
  const Status status = FollowUndamped(source, ids, !knows_weakest, staleness, joint);
  if (status.ok() && row >= 0) {
    undamped.Remember(schur, row, *joint);
  }
  return status;
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

void Clear(LiveCovariance* covariance) {
  covariance->variables.clear();
  covariance->offsets.clear();
  covariance->values.clear();
  covariance->staleness = FactorStaleness();
}

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
                 ? Undamped(source, moving, &staleness, &joint)
                 : AsFactored(source, moving, options, &staleness, &joint);
    if (status.ok()) {
      Place(source, joint, covariance);
    }
  }
  if (!status.ok()) {
    // Nothing but the staleness is left of a failure.
    Clear(covariance);
  }
  covariance->staleness = staleness;
  return status;
}

}  // namespace internal
}  // namespace inceres
