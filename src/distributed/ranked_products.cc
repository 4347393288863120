#include <algorithm>
#include <cmath>
#include <utility>

#include "base/sort_unique.h"
#include "distributed/ranked_two_level.h"

namespace inceres::internal {

// A V for A = S + Λ_c over ranks. What a rank can compute is the share of its own factors and
// landmarks (ProjectedProducts),
//
//     (A V)_ia = Σ_{j∈a} C_ij V_j − Σ_l Y_liᵀ Z_la,   Z_la = Σ_{j∈a} Y_lj V_j,
//
// for the rows i of frames it has. Shares of a row go to the owner of its frame and are summed
// there: the owner's own first, then those of the others by ascending rank, the same order each
// time. Λ_c V is added once, by the owner.
//
// A share has as many blocks as the rank's frames reach aggregates. To keep it small, aggregates
// are cut into batches, the same on all ranks, and the columns of one batch after the other are
// formed, sent and dropped. Kept: the plan of each batch, V and A V of the owned rows.
//
// Blocks have two names. A place is their position in some CoarseColumns; a key, frame number and
// aggregate, is understood by all ranks. Keys are exchanged once; then values travel in the same
// order.

namespace {

// Of the largest share among the ranks.
constexpr double kBytesPerBatch = 64.0 * 1024.0 * 1024.0;

// The blocks of C; the Hessian keeps them where they are while their values change.
std::vector<const double*> BlocksOf(const Hessian& hessian, const FramePlans& plans) {
  std::vector<const double*> blocks;
  for (std::size_t k = 0; k < plans.block_row.size(); ++k) {
    blocks.push_back(hessian.FrameBlock(static_cast<int>(k)));
  }
  return blocks;
}

// The part of lists that belongs to aggregates first ≤ a < last; the others are empty.
// Compressed lists by aggregate: the begins keep their number, so that aggregates keep theirs.
void Cut(const std::vector<int>& all_begin, const std::vector<int>& all, int first, int last,
         std::vector<int>* begin, std::vector<int>* list) {
  const int from = all_begin[first], to = all_begin[last];
  begin->clear();
  for (const int b : all_begin) {
    begin->push_back(std::clamp(b, from, to) - from);
  }
  list->assign(all.begin() + from, all.begin() + to);
}

// The columns of some aggregates; all frames remain as rows, and widths of all as they are, so that
// V is laid out as before.
AggregateReach Slice(const AggregateReach& reach, int first, int last) {
  AggregateReach slice;
  slice.shape.aggregate_of = reach.shape.aggregate_of;
  slice.shape.widths = reach.shape.widths;
  Cut(reach.shape.coupled_begin, reach.shape.coupled, first, last, &slice.shape.coupled_begin,
      &slice.shape.coupled);
  Cut(reach.landmarks_begin, reach.landmarks, first, last, &slice.landmarks_begin,
      &slice.landmarks);
  return slice;
}

// visit(place, row, aggregate)
// The order that all exchanges rely on: by aggregate, within it by ascending row of this rank's
// layout.
template <typename Visit>
void ForEachPlace(const CoarseShape& shape, const Visit& visit) {
  for (int a = 0; a < shape.num_aggregates(); ++a) {
    for (int place = shape.coupled_begin[a]; place < shape.coupled_begin[a + 1]; ++place) {
      visit(place, shape.coupled[place], a);
    }
  }
}

}  // namespace

// Ordered by aggregate first, as CoarseShape lists the rows of each.
struct RankedProducts::Key {
  int number;  // of a frame
  int aggregate;

  friend bool operator<(const Key& a, const Key& b) {
    return std::pair(a.aggregate, a.number) < std::pair(b.aggregate, b.number);
  }
  friend bool operator==(const Key& a, const Key& b) {
    return a.aggregate == b.aggregate && a.number == b.number;
  }
};

RankedProducts::RankedProducts(const RankedParts& parts, const FrameAggregates& here,
                               const std::vector<int>& widths)
    : parts_(parts),
      offsets_(parts.plans.pattern.offsets),
      products_(parts.incidences, parts.plans, BlocksOf(parts.hessian, parts.plans),
                &parts.elimination),
      // Shares are formed without Λ_c.
      no_damping_(offsets_.back(), 0.0) {
  // Of this rank; what the owned rows reach is the union over ranks, and found by an exchange.
  const AggregateReach reach(here, widths, parts.incidences, parts.plans.pattern);
  owned_ = std::make_unique<CoarseColumns>(parts.frames.owned_offsets(), ShapeOfOwned(reach.shape),
                                           parts.evaluator.executor());
  ForEachPlace(owned_->shape(), [&](int, int row, int aggregate) {
    block_sizes_.push_back(owned_->block_size(row) * owned_->stride(aggregate));
  });
  CutIntoBatches(reach);
}

// What other ranks have of rows owned here: in the order of the ranks, of each by aggregates.
std::vector<RankedProducts::Key> RankedProducts::ExchangeKeys(const CoarseShape& shape) const {
  std::vector<std::vector<Key>> to_rank(parts_.ranks.size());
  ForEachPlace(shape, [&](int, int row, int aggregate) {
    const FramePlace& place = parts_.frames.moving()[row];
    if (place.owner != parts_.ranks.rank()) {
      to_rank[place.owner].push_back({place.number, aggregate});
    }
  });
  return parts_.ranks.SendToEach(std::move(to_rank));
}

// The union of what the ranks have.
// A rank may have a row coupled to an aggregate of which the owner sees nothing: through a
// landmark, or a factor, of its own.
CoarseShape RankedProducts::ShapeOfOwned(const CoarseShape& here) const {
  std::vector<Key> keys = ExchangeKeys(here);
  ForEachPlace(here, [&](int, int row, int aggregate) {
    const FramePlace& place = parts_.frames.moving()[row];
    if (place.owner == parts_.ranks.rank()) {
      keys.push_back({place.number, aggregate});
    }
  });
  SortUnique(&keys);
  CoarseShape shape;
  shape.widths = here.widths;
  for (const int position : parts_.frames.owned()) {
    shape.aggregate_of.push_back(here.aggregate_of[position]);
  }
  auto next = keys.begin();
  shape.coupled_begin.push_back(0);
  for (int a = 0; a < shape.num_aggregates(); ++a) {
    for (; next != keys.end() && next->aggregate == a; ++next) {
      shape.coupled.push_back(parts_.frames.OwnedRow(next->number));
    }
    shape.coupled_begin.push_back(static_cast<int>(shape.coupled.size()));
  }
  return shape;
}

// Of a key whose frame is owned here.
int RankedProducts::PlaceOf(const Key& key) const {
  return owned_->PlaceOf(parts_.frames.OwnedRow(key.number), key.aggregate);
}

// As many on all ranks, of the same aggregates.
// The number of batches follows from the largest share, a maximum that is agreed on, and the
// aggregates of a batch from that number: each batch has collective calls.
void RankedProducts::CutIntoBatches(const AggregateReach& reach) {
  double bytes = 0.0;
  ForEachPlace(reach.shape, [&](int, int row, int aggregate) {
    bytes += static_cast<double>(sizeof(double)) * (offsets_[row + 1] - offsets_[row]) *
             owned_->stride(aggregate);
  });
  const int count = reach.shape.num_aggregates();
  const double wanted = std::ceil(parts_.ranks.Max(bytes) / kBytesPerBatch);
  const int num_batches = static_cast<int>(std::clamp(wanted, 1.0, std::max(1.0, 1.0 * count)));
  for (int b = 0; b < num_batches; ++b) {
    // A product of ints may overflow, hence the wider argument.
    const auto begin_of = [&](std::int64_t k) { return static_cast<int>(count * k / num_batches); };
    Batch batch;
    batch.reach = Slice(reach, begin_of(b), begin_of(b + 1));
    Plan(&batch);
    batches_.push_back(std::move(batch));
  }
}

// Done once: places to read from and to add to, in the order in which FormBatch goes through them.
// Collective, as keys are exchanged.
void RankedProducts::Plan(Batch* batch) const {
  batch->sent.resize(parts_.ranks.size());
  ForEachPlace(batch->reach.shape, [&](int at, int row, int aggregate) {
    const FramePlace& place = parts_.frames.moving()[row];
    if (place.owner == parts_.ranks.rank()) {
      batch->own_from.push_back(at);
      batch->own_to.push_back(PlaceOf({place.number, aggregate}));
    } else {
      batch->sent[place.owner].push_back(at);
    }
  });
  for (const Key& key : ExchangeKeys(batch->reach.shape)) {
    batch->received_to.push_back(PlaceOf(key));
  }
}

void RankedProducts::Add(const double* block, int place) {
  double* const sum = owned_->AV(place);
  for (int k = 0; k < block_sizes_[place]; ++k) {
    sum[k] += block[k];
  }
}

// The columns are allocated for the batch, and V is copied in for all frames here: row i of A V
// needs V_j of frames j that others own as well, which is why every rank has V of all.
void RankedProducts::FormBatch(const Batch& batch, const RankedModes& modes) {
  const CoarseShape& shape = batch.reach.shape;
  CoarseColumns columns(offsets_, shape, parts_.evaluator.executor());
  for (int i = 0; i < columns.num_rows(); ++i) {
    std::copy_n(modes.V(parts_.frames.moving()[i].number),
                columns.block_size(i) * columns.stride(shape.aggregate_of[i]), columns.V(i));
  }
  products_.Form(batch.reach, no_damping_.data(), parts_.evaluator.executor(), &columns);
  for (std::size_t k = 0; k < batch.own_from.size(); ++k) {
    Add(columns.AV(batch.own_from[k]), batch.own_to[k]);
  }
  // Entries of each place of the batch, padding included, so blocks are sent as they lie.
  std::vector<int> sizes;
  ForEachPlace(shape, [&](int, int row, int aggregate) {
    sizes.push_back(columns.block_size(row) * columns.stride(aggregate));
  });
  std::vector<std::vector<double>> to_rank(batch.sent.size());
  for (std::size_t r = 0; r < to_rank.size(); ++r) {
    for (const int place : batch.sent[r]) {
      const double* const block = columns.AV(place);
      to_rank[r].insert(to_rank[r].end(), block, block + sizes[place]);
    }
  }
  const std::vector<double> received = parts_.ranks.SendToEach(std::move(to_rank));
  const double* next = received.data();
  // Both ends have the same width for an aggregate, so sizes agree: those of the owned places.
  for (const int place : batch.received_to) {
    Add(next, place);
    next += block_sizes_[place];
  }
}

// Λ_c V, once.
// (Λ_c V)_ia is not zero only where the frame i is in a, and that place is there for each row.
void RankedProducts::AddDamping(const std::vector<double>& owned_damping) {
  const double* lambda = owned_damping.data();
  for (int row = 0; row < owned_->num_rows(); ++row) {
    const int aggregate = owned_->shape().aggregate_of[row];
    const int stride = owned_->stride(aggregate);
    const double* const V = owned_->V(row);
    double* const A_V = owned_->AV(owned_->PlaceOf(row, aggregate));
    for (int r = 0; r < owned_->block_size(row); ++r) {
      for (int k = 0; k < stride; ++k) {
        A_V[r * stride + k] += lambda[r] * V[r * stride + k];
      }
    }
    lambda += owned_->block_size(row);
  }
}

// Sums begin at zero each time. V of the owned rows is copied too, for the products with vectors.
void RankedProducts::Form(const RankedModes& modes, const std::vector<double>& owned_damping) {
  for (std::size_t place = 0; place < block_sizes_.size(); ++place) {
    std::fill_n(owned_->AV(static_cast<int>(place)), block_sizes_[place], 0.0);
  }
  for (int row = 0; row < owned_->num_rows(); ++row) {
    const FramePlace& place = parts_.frames.moving()[parts_.frames.owned()[row]];
    const int stride = owned_->stride(owned_->shape().aggregate_of[row]);
    std::copy_n(modes.V(place.number), owned_->block_size(row) * stride, owned_->V(row));
  }
  for (const Batch& batch : batches_) {
    FormBatch(batch, modes);
  }
  AddDamping(owned_damping);
}

std::int64_t RankedProducts::Bytes() const {
  std::size_t ints = block_sizes_.size();
  for (const Batch& batch : batches_) {
    ints += batch.reach.shape.coupled.size() + batch.reach.landmarks.size() +
            batch.own_from.size() + batch.own_to.size() + batch.received_to.size();
    for (const std::vector<int>& sent : batch.sent) {
      ints += sent.size();
    }
  }
  return owned_->Bytes() + static_cast<std::int64_t>(ints * sizeof(int));
}

}  // namespace inceres::internal
