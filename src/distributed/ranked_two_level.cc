#include "distributed/ranked_two_level.h"

#include <algorithm>
#include <functional>

#include "base/sort_unique.h"

namespace inceres::internal {

// The two-level preconditioner over ranks (docs/algorithms.md, "Reduced linear systems"; Mandel
// 1993),
//
//     M⁻¹ = (I − Q A) D⁻¹ (I − A Q) + Q,   Q = V (VᵀA V)⁻¹ Vᵀ,   A = S + Λ_c.
//
// Rows of V and A V lie with the owners of frames, D is block diagonal by owners. VᵀA V is small:
// each rank computes what its rows add, all get the sum, and each factors it. So the coarse
// solutions q and t need no exchange, and have the same bits on all ranks; an application exchanges
// two vectors of a few numbers an aggregate, of the aggregates that a rank has a part of.
//
// Kept: aggregates for the structure; V until Refresh; D, A V and the factor until the damping
// changes, that is until the next Prepare. A refused step thus pays for A V and the factor, and not
// for V.

namespace {

// Ascending.
std::vector<int> Unique(std::vector<int> values) {
  SortUnique(&values);
  return values;
}

}  // namespace

RankedTwoLevel::RankedTwoLevel(const Communicator& ranks, const SharedFrames& frames,
                               const Evaluator& evaluator, const LandmarkIncidences& incidences,
                               const FramePlans& plans, const Hessian& hessian,
                               const Elimination& elimination, const RankedAggregates& aggregates,
                               Status* modes_status, Status* factor_status)
    // Each member is made by all ranks together and in this order; the later ones read shapes of
    // those above.
    : ranks_(ranks),
      elimination_(elimination),
      modes_(ranks, frames, aggregates.by_frame, evaluator, hessian, plans, aggregates.all,
             aggregates.here, modes_status),
      products_(ranks, frames, evaluator, incidences, plans, hessian, elimination, aggregates.here,
                modes_.widths()),
      galerkin_(ranks, modes_.widths(), PlacesOfOwned()),
      restricted_sums_(ranks, AggregatesOfOwned()),
      product_sums_(ranks, AggregatesReached()),
      factor_(galerkin_.pattern(), evaluator.executor(), factor_status),
      column_begin_(SegmentBegins(modes_.widths())) {
  for (std::vector<double>* vector : {&restricted_, &q_, &correction_}) {
    vector->resize(static_cast<std::size_t>(column_begin_.back()));
  }
  // Vectors over frames begin each frame on a quad, those over columns are packed by aggregate.
  std::size_t padded_size = 0;
  for (const int position : frames.owned()) {
    padded_size += PadToQuad(frames.moving()[position].sizes[FramePlace::kTangent]);
  }
  deflated_.resize(padded_size);
}

std::unique_ptr<RankedTwoLevel> RankedTwoLevel::Make(
    const Communicator& ranks, const SharedFrames& frames, const Evaluator& evaluator,
    const LandmarkIncidences& incidences, const FramePlans& plans, const Hessian& hessian,
    const Elimination& elimination, const RankedAggregates& aggregates, Status* status) {
  // The three statuses are those of all ranks, or made so at once, so that no rank leaves alone; an
  // analysis of the same pattern fails on all.
  Status of_modes, of_factor;
  std::unique_ptr<RankedTwoLevel> two_level(new RankedTwoLevel(ranks, frames, evaluator, incidences,
                                                               plans, hessian, elimination,
                                                               aggregates, &of_modes, &of_factor));
  two_level->fine_ = std::make_unique<FineBlocks>(ranks, frames, plans.pattern, aggregates.by_owner,
                                                  evaluator.executor(), status);
  *status = status->ok() ? of_modes : *status;
  *status = status->ok() ? ranks.Agree(of_factor) : *status;
  return two_level;
}

// Whose columns of Vᵀr this rank has a part of.
std::vector<int> RankedTwoLevel::AggregatesOfOwned() const {
  return Unique(products_.owned().shape().aggregate_of);
}

// The same of (A V)ᵀz: aggregates whose columns of A V have an owned row. More than the above.
std::vector<int> RankedTwoLevel::AggregatesReached() const {
  const std::vector<int>& begin = products_.owned().shape().coupled_begin;
  std::vector<int> reached;
  for (int a = 0; a + 1 < static_cast<int>(begin.size()); ++a) {
    if (begin[a] < begin[a + 1]) {
      reached.push_back(a);
    }
  }
  return reached;
}

// Blocks of VᵀA V that owned rows add to: those in the rows of their aggregates.
std::vector<BlockSums::Place> RankedTwoLevel::PlacesOfOwned() const {
  const BlockPattern pattern = products_.owned().GalerkinPattern();
  std::vector<BlockSums::Place> places;
  // A row i adds V_iᵀ (A V)_ib to the block (a, b) of its own aggregate a. The pattern has the
  // diagonal of all aggregates; those of others are left to them.
  for (const int a : AggregatesOfOwned()) {
    for (int k = pattern.row_begin[a]; k < pattern.row_begin[a + 1]; ++k) {
      places.emplace_back(a, pattern.columns[k]);
    }
  }
  return places;
}

// After an elimination: reads the blocks of S within D, and Y for A V. Statuses are the same on all
// ranks.
Status RankedTwoLevel::Prepare(const std::vector<double>& owned_damping) {
  if (modes_are_stale_) {
    modes_.Compute();
    modes_are_stale_ = false;
  }
  const Status status = fine_->Factorize(elimination_.S(), owned_damping);
  if (!status.ok()) {
    return status;
  }
  products_.Form(modes_, owned_damping);
  // What the owned rows add, in the pattern of all ranks.
  products_.owned().FormGalerkin(factor_.pattern(), factor_.values());
  galerkin_.Sum(factor_.values());
  return ranks_.Agree(factor_.Factorize());
}

// With q = (VᵀA V)⁻¹ Vᵀ r and z = D⁻¹ (r − A V q), the result is
//
//     z + V (q − t),   t = (VᵀA V)⁻¹ (A V)ᵀ z,
//
// since Q r = V q and Q A z = V t by the symmetry of A. A V is at hand, so no product with S is
// taken.
void RankedTwoLevel::Apply(const double* r, double* z) {
  const CoarseColumns& owned = products_.owned();
  owned.Restrict(r, restricted_.data());
  restricted_sums_.Sum(column_begin_, restricted_.data());
  factor_.Solve(restricted_.data(), q_.data());
  owned.SubtractProducts(q_.data(), r, deflated_.data());
  fine_->Apply(deflated_.data(), z);
  owned.RestrictProducts(z, restricted_.data());
  product_sums_.Sum(column_begin_, restricted_.data());
  factor_.Solve(restricted_.data(), correction_.data());
  // correction := q − t.
  std::transform(q_.begin(), q_.end(), correction_.begin(), correction_.begin(), std::minus<>());
  owned.Prolong(correction_.data(), z);
}

std::int64_t RankedTwoLevel::Bytes() const {
  return modes_.Bytes() + products_.Bytes() + factor_.Bytes() + fine_->Bytes() +
         restricted_sums_.Bytes() + product_sums_.Bytes() +
         static_cast<std::int64_t>((3 * q_.size() + deflated_.size()) * sizeof(double));
}

}  // namespace inceres::internal
