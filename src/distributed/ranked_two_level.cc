#include "distributed/ranked_two_level.h"

#include <algorithm>
#include <functional>
#include <utility>

#include "base/sort_unique.h"
#include "linear/pattern_rows.h"

namespace inceres::internal {

// The two-level preconditioner over ranks (docs/algorithms.md, "Reduced linear systems"; Mandel
// 1993),
//
//     M⁻¹ = (I − Q A) D⁻¹ (I − A Q) + Q,   Q = V (VᵀA V)⁻¹ Vᵀ,   A = S + Λ_c.
//
// Rows of V and A V lie with the owners of frames. D has those blocks of A whose two frames are in
// the same aggregate and have the same owner, so it is block diagonal by owners: applying D⁻¹ sends
// nothing, and M remains symmetric. What it loses against one process are blocks of an aggregate
// that several ranks own.
//
// VᵀA V is small: each rank computes what its rows add, all get the sum, and each factors it. So
// the coarse solutions q and t need no exchange, and have the same bits on all ranks; an
// application exchanges two vectors of a few numbers an aggregate, of the aggregates that a rank
// has a part of.
//
// Kept: aggregates for the structure; V until Refresh; D, A V and the factor until the damping
// changes, that is until the next Prepare. A refused step thus pays for A V and the factor, and not
// for V.

RankedTwoLevel::RankedTwoLevel(const RankedParts& parts, const RankedAggregates& aggregates,
                               Status* status)
    // Each member is made by all ranks together and in this order; the later ones read shapes of
    // those above.
    : parts_(parts),
      modes_(parts, aggregates, status),
      products_(parts, aggregates.here, modes_.widths()),
      galerkin_(parts.ranks, modes_.widths(), PlacesOfOwned()),
      restricted_sums_(parts.ranks, AggregatesOfOwned()),
      product_sums_(parts.ranks, AggregatesReached()),
      fine_shares_(parts, &aggregates.by_owner, BlockShares::Form::kLower,
                   BlockShares::Order::kOwnFirst),
      column_begin_(SegmentBegins(modes_.widths())) {
  const Executor& executor = parts.evaluator.executor();
  // The statuses are those of all ranks, or made so at once, so that no rank leaves alone; an
  // analysis of the same pattern fails on all.
  Status of_fine, of_factor;
  factor_ = std::make_unique<CoarseFactor>(galerkin_.pattern(), executor, &of_factor);
  // Only what belongs into D is in the pattern, so it is one cluster.
  FrameClusters whole;
  whole.cluster_of.assign(parts.frames.owned().size(), 0);
  fine_ = std::make_unique<ClusterCholesky>(FinePattern(), whole, executor, &of_fine);
  of_fine = parts.ranks.Agree(of_fine);
  *status = of_fine.ok() ? *status : of_fine;
  *status = status->ok() ? parts.ranks.Agree(of_factor) : *status;
  for (std::vector<double>* vector : {&restricted_, &q_, &correction_}) {
    vector->resize(static_cast<std::size_t>(column_begin_.back()));
  }
  // Vectors over frames begin each frame on a quad, those over columns are packed by aggregate.
  deflated_.resize(parts.frames.padded_owned_size());
}

// The blocks of D owned here, by the owned frames. Every row has its diagonal block, for the
// owner's own factors touch each frame it owns.
BlockPattern RankedTwoLevel::FinePattern() const {
  const std::vector<int>& offsets = parts_.frames.owned_offsets();
  const auto row_of = [&](std::int64_t begin) {
    const std::int64_t own = begin - parts_.frames.owned_begin(FramePlace::kTangent);
    return static_cast<int>(std::lower_bound(offsets.begin(), offsets.end(), own) -
                            offsets.begin());
  };
  std::vector<std::pair<int, int>> places;
  for (const BlockShares::OwnedBlock& block : fine_shares_.owned()) {
    places.emplace_back(row_of(block.place.row), row_of(block.place.column));
  }
  return PatternOf(offsets, places);
}

// Whose columns of Vᵀr this rank has a part of.
std::vector<int> RankedTwoLevel::AggregatesOfOwned() const {
  std::vector<int> aggregates = products_.owned().shape().aggregate_of;
  SortUnique(&aggregates);
  return aggregates;
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
  // Λ_c is added to the sums, once. A block without a factor on one rank is a failure of all: they
  // would part otherwise.
  const Status status =
      parts_.ranks.Agree(fine_->Factorize(fine_shares_.Sum().data(), owned_damping.data()));
  if (!status.ok()) {
    return status;
  }
  products_.Form(modes_, owned_damping);
  // What the owned rows add, in the pattern of all ranks.
  products_.owned().FormGalerkin(factor_->pattern(), factor_->values());
  galerkin_.Sum(factor_->values());
  return parts_.ranks.Agree(factor_->Factorize());
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
  factor_->Solve(restricted_.data(), q_.data());
  owned.SubtractProducts(q_.data(), r, deflated_.data());
  fine_->Apply(deflated_.data(), z);
  owned.RestrictProducts(z, restricted_.data());
  product_sums_.Sum(column_begin_, restricted_.data());
  factor_->Solve(restricted_.data(), correction_.data());
  // correction := q − t.
  std::transform(q_.begin(), q_.end(), correction_.begin(), correction_.begin(), std::minus<>());
  owned.Prolong(correction_.data(), z);
}

std::int64_t RankedTwoLevel::Bytes() const {
  return modes_.Bytes() + products_.Bytes() + factor_->Bytes() + fine_shares_.Bytes() +
         fine_->Bytes() + restricted_sums_.Bytes() + product_sums_.Bytes() +
         static_cast<std::int64_t>((3 * q_.size() + deflated_.size()) * sizeof(double));
}

}  // namespace inceres::internal
