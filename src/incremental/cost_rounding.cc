#include "incremental/cost_rounding.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace inceres::internal {

// How much of the cost is rounding (docs/algorithms.md, "Stopping rule"):
//
//     F_ε = min(Σ r, 1000 (Σ r^¼)⁴ / N³)  ≤  ½ (n ε)² Σ_v ‖x_v‖_∞² tr C_vv,    n = 16,
//     r   = ½ min(‖q_i‖, n ε ‖J_iv‖ ‖x_v‖_∞)²   of the N pairs v, i∋v for which it is not zero.
//
// The tolerance asks for it, since no minimum is known better than the cost is. AtMost is the sum
// on the right, which needs the diagonal of C and no factor; OfResiduals is F_ε. It is Σ r unless a
// few of these are many orders above the others, as that of a point next to a camera's center: the
// cost is blurred by them, and what all the others have left to gain is not. Both run over the
// frames v, and over the landmarks where no frame can move: a factor of two frames counts with
// both.
//
// What a frame adds is kept in a tree of sums by rows of S, so an Update costs what has changed,
// and the bits are those of a sum that was made from nothing: pairs are added, then pairs of these,
// whatever was before. The landmarks' sum is made anew each time, in their order.
//
// J is the cached one, with its weight √w, and q the residual as that Jacobian sees it, so that
// both are in units of the square root of the cost. Norms are Frobenius norms: tr C_vv = Σ_i
// ‖J_iv‖².

namespace {

// Operations on numbers of full size that a residual is taken to come of; and what they round.
constexpr double kOperations = 16.0;
constexpr double kRounding = kOperations * std::numeric_limits<double>::epsilon();

// Times the power mean of what residuals are rounded by: their mean may be so much, by a few that
// are unlike the others.
constexpr double kUnlike = 1000.0;

// min(most, factor ‖J‖²), reading no more rows of J than that takes. The sum only grows, so it may
// stop where it has reached `most`: of a residual of zero, as a prior that holds has, nothing is
// read at all.
double LeastOf(double most, double factor, const SlotJacobians& slot, const double* J, int rows) {
  double least = 0.0;
  for (int k = 0; k < rows && least < most; ++k, J += slot.row_stride) {
    for (int c = 0; c < slot.columns; ++c) {
      least += factor * J[c] * J[c];
    }
  }
  return std::min(most, least);
}

}  // namespace

// ‖x_v‖_∞ of the values now, in the ambient space: of a quaternion that is at most 1, of a position
// it grows with the distance from the origin, and so does what a difference of two positions is
// rounded by.
double CostRounding::LargestValue(VariableId id) const {
  double largest = 0.0;
  for (int k = 0; k < graph_.AmbientSize(id); ++k) {
    largest = std::max(largest, std::fabs(variables_.current(id)[k]));
  }
  return largest;
}

// ½ (n ε)² ‖x_v‖_∞² tr C_vv, of diagonal entries that lie `stride` apart.
double CostRounding::MostOf(VariableId id, int size, const double* diagonal, int stride) const {
  double trace = 0.0;
  for (int k = 0; k < size; ++k) {
    trace += diagonal[k * stride];
  }
  const double rounding = kRounding * LargestValue(id);
  return 0.5 * rounding * rounding * trace;
}

// Zero of a free row and of a frame that is held. The diagonal is that of C, before landmarks are
// eliminated: S_vv is smaller, and would tell of the rounding of a difference, not of residuals.
double CostRounding::MostOfFrame(std::int32_t row) const {
  const IncrementalSchur::Frame& frame = schur_.frames()[row];
  const bool moves = frame.id >= 0 && !frame.held;
  return moves ? MostOf(frame.id, frame.size, schur_.FrameDiagonal(row), 1) : 0.0;
}

// Zero outside S, where a landmark does not move. In P rows are a quad apart, hence the stride from
// one diagonal entry to the next.
double CostRounding::MostOfLandmark(std::int32_t l) const {
  const IncrementalSchur::Landmark& landmark = schur_.landmarks()[l];
  const bool moves = landmark.id >= 0 && schur_.IsInS(l);
  return moves ? MostOf(landmark.id, landmark.size, schur_.blocks().P(l), kQuad + 1) : 0.0;
}

// The most of all frames together; what has changed waits to be asked for its residuals. A new row
// counts as changed; they ascend, as SumTree asks for.
double CostRounding::Follow() {
  const std::size_t num_rows = schur_.frames().size();
  most_.Grow(num_rows);
  unasked_.Grow(num_rows);
  schur_.changes().TakeUnbounded(&changed_);
  most_.Set(changed_, [this](std::int32_t row) { return MostOfFrame(row); });
  std::for_each(changed_.begin(), changed_.end(), [this](std::int32_t row) { unasked_.Add(row); });
  return most_.sum();
}

double CostRounding::AtMost() {
  const double of_frames = Follow();
  if (of_frames > 0.0) {
    return of_frames;
  }
  // Where no frame can move, the landmarks' own factors are all that blurs the cost. Free places
  // among them are zero.
  double sum = 0.0;
  for (std::int32_t l = 0; l < static_cast<std::int32_t>(schur_.landmarks().size()); ++l) {
    sum += MostOfLandmark(l);
  }
  return sum;
}

// Frames that have not changed since they were asked last keep their share; those that have are
// `unasked_`, which may have gathered over several calls of AtMost. Of a frame or landmark whose
// bound is zero nothing is asked: it does not move, or no factor reaches it.
double CostRounding::OfResiduals() {
  double most = Follow();
  if (!(most > 0.0)) {
    Share all;
    for (std::int32_t l = 0; l < static_cast<std::int32_t>(schur_.landmarks().size()); ++l) {
      const double most_of_landmark = MostOfLandmark(l);
      if (most_of_landmark > 0.0) {
        AddTo(&all, {schur_.landmarks()[l].id, -1, l});
      }
      most += most_of_landmark;
    }
    return all.Typical(most);
  }
  sums_.Grow(schur_.frames().size());
  roots_.Grow(schur_.frames().size());
  counts_.Grow(schur_.frames().size());
  unasked_.CopyTo(&changed_);
  unasked_.Clear();
  shares_.resize(schur_.frames().size());
  for (const std::int32_t row : changed_) {
    Share& share = shares_[row] = Share();
    if (most_[row] > 0.0) {
      AddTo(&share, {schur_.frames()[row].id, row, -1});
    }
  }
  sums_.Set(changed_, [this](std::int32_t row) { return std::min(most_[row], shares_[row].sum); });
  roots_.Set(changed_, [this](std::int32_t row) { return shares_[row].roots; });
  counts_.Set(changed_, [this](std::int32_t row) { return shares_[row].count; });
  return Share{sums_.sum(), roots_.sum(), counts_.sum()}.Typical(most);
}

// The second is a multiple of N times a power mean, which a few cannot raise. Never above the
// bound, also where rounding of the sums would have it so.
double CostRounding::Share::Typical(double most) const {
  const double mean_root = count > 0.0 ? roots / count : 0.0;
  const double squared = mean_root * mean_root;
  return std::min({most, sum, kUnlike * count * squared * squared});
}

template <typename Visit>
// A frame's factors are its own, which touch no landmark, and those between it and each landmark
// that it sees; a landmark lists all of its factors itself.
void CostRounding::ForEachFactorOf(const Part& part, const Visit& visit) const {
  if (part.frame < 0) {
    const std::vector<FactorRef>& factors = schur_.landmarks()[part.landmark].factors;
    std::for_each(factors.begin(), factors.end(), visit);
    return;
  }
  const IncrementalSchur::Frame& frame = schur_.frames()[part.frame];
  std::for_each(frame.factors.begin(), frame.factors.end(), visit);
  for (const std::int32_t landmark : frame.landmarks) {
    schur_.structure().ForEachFactorBetween(landmark, part.frame, visit);
  }
}

// r and r^¼ of the variable's factors. Factors that are not linearized have no J to ask.
void CostRounding::AddTo(Share* share, const Part& part) const {
  const double rounding = kRounding * LargestValue(part.id);
  ForEachFactorOf(part, [&](const FactorRef& ref) {
    const IncrementalFamily& family = families_[ref.family];
    if (!family.weighed().linearized(ref.factor)) {
      return;
    }
    const double* q = family.weighed().q(ref.factor);
    const double squared = std::inner_product(q, q + family.residual_size(), q, 0.0);
    for (int s = 0; squared > 0.0 && s < family.num_slots(); ++s) {
      if (family.variables(ref.factor)[s] == part.id) {
        const double r = 0.5 * LeastOf(squared, rounding * rounding, family.slots()[s],
                                       family.Jacobian(ref.factor, s), family.residual_size());
        share->sum += r;
        share->roots += std::sqrt(std::sqrt(r));
        share->count += r > 0.0 ? 1.0 : 0.0;
      }
    }
  });
}

}  // namespace inceres::internal
