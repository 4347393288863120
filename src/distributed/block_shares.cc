#include "distributed/block_shares.h"

#include <algorithm>
#include <climits>
#include <numeric>
#include <tuple>
#include <utility>

#include "distributed/petsc_objects.h"

namespace inceres::internal {

// A rank has its own factors and landmarks only, so the block (i, j) of its S = C − Y Yᵀ is one
// term of a sum over all ranks; rows belong to the owners of their frames.
//
// Who sends which block to whom is found once, for the structure stays in a solve. Kept between
// calls: the plan and the buffers. Sum packs, exchanges values only, and sums them in one order
// from zero on: the same ranks give the same bits.
//
// The pattern that FramePlans have is lower triangular in the order of this rank's layout; the
// matrix of all has the order of all ranks, by owner and then by id. So a block may lie the other
// way around there.

namespace {

// As MPI counts values: no rank sends more than 16 GiB of a matrix, nor 2 GiB of places.
// MPI takes counts as int. Throws on this rank alone: an agreement, or the end of the program,
// tells the others.
int ToCount(std::int64_t count) {
  if (count > INT_MAX) {
    throw PetscFailure(PETSC_ERR_ARG_OUTOFRANGE, "a rank's share of S is too large to be sent");
  }
  return static_cast<int>(count);
}

// Exclusive prefix sums. The total is checked too, since it is the length of the buffer.
std::vector<int> BeginsOf(const std::vector<int>& counts) {
  std::vector<int> begins(counts.size(), 0);
  std::int64_t total = 0;
  for (std::size_t r = 0; r < counts.size(); ++r) {
    begins[r] = ToCount(total);
    total += counts[r];
  }
  ToCount(total);
  return begins;
}

std::int64_t SizeOf(const BlockShares::Place& place) {
  return std::int64_t{place.rows} * place.columns;
}

}  // namespace

// What this rank does by itself is agreed on before the first exchange; what throws later ends the
// program, for the others are in the midst of one.
BlockShares::BlockShares(const RankedParts& parts, const FrameClusters* clusters, Form form,
                         Order order)
    : parts_(parts) {
  std::vector<std::vector<Place>> places;
  const Status collected = parts.ranks.Try([&] {
    NumberShares(CollectShares(clusters, form), &places);
    return Status::Ok();
  });
  if (!collected.ok()) {
    throw AgreedFailure(collected);
  }
  PlanSums(PlanExchange(std::move(places)), order);
}

// Each block of the local pattern becomes a share for the owner of its row. A triangle has one
// share for each block, turned to its side of the diagonal; the whole form has two, of which one is
// the transpose, and one on the diagonal.
std::vector<std::vector<BlockShares::Share>> BlockShares::CollectShares(
    const FrameClusters* clusters, Form form) const {
  std::vector<std::vector<Share>> of_rank(static_cast<std::size_t>(parts_.ranks.size()));
  const FramePlans& plans = parts_.plans;
  const std::vector<FramePlace>& frames = parts_.frames.moving();
  const auto add = [&](const FramePlace& row, const FramePlace& column, int block,
                       bool transposed) {
    // Index 0 is FramePlace::kTangent: begin is the first scalar row in the matrix.
    const Place place{row.begin[0], column.begin[0], row.sizes[0], column.sizes[0]};
    of_rank[static_cast<std::size_t>(row.owner)].push_back({place, block, transposed});
  };
  for (std::size_t k = 0; k < plans.block_row.size(); ++k) {
    if (clusters != nullptr && !clusters->Keeps(plans.block_row[k], plans.pattern.columns[k])) {
      continue;
    }
    const FramePlace& i = frames[static_cast<std::size_t>(plans.block_row[k])];
    const FramePlace& j = frames[static_cast<std::size_t>(plans.pattern.columns[k])];
    const auto block = static_cast<int>(k);
    const bool upper = i.begin[0] <= j.begin[0];
    if (form == Form::kWhole && &i != &j) {
      add(i, j, block, false);
      add(j, i, block, true);
    } else if (upper == (form == Form::kUpper) || &i == &j) {
      add(i, j, block, false);
    } else {
      add(j, i, block, true);
    }
  }
  return of_rank;
}

// Shares are concatenated by rank of destination, and `shares_` keeps that order for PackShares.
// Also whether MPI can count them: the values, and the bytes of the places.
void BlockShares::NumberShares(const std::vector<std::vector<Share>>& of_rank,
                               std::vector<std::vector<Place>>* places) {
  const auto num_ranks = of_rank.size();
  places->resize(num_ranks);
  to_ranks_.counts.assign(num_ranks, 0);
  from_ranks_.counts.assign(num_ranks, 0);
  for (std::size_t r = 0; r < num_ranks; ++r) {
    std::int64_t num_values = 0;
    for (const Share& share : of_rank[r]) {
      shares_.push_back(share);
      (*places)[r].push_back(share.place);
      num_values += SizeOf(share.place);
    }
    to_ranks_.counts[r] = ToCount(num_values);
  }
  to_ranks_.begins = BeginsOf(to_ranks_.counts);
  ToCount(static_cast<std::int64_t>(shares_.size() * sizeof(Place)));
}

// Places travel once; afterwards position k in the stream of values means place k, in the order of
// the ranks. A rank sends to itself like to others, so that one loop sums all.
std::vector<BlockShares::Place> BlockShares::PlanExchange(std::vector<std::vector<Place>> places) {
  const Communicator& ranks = parts_.ranks;
  // Receivers learn the counts of values first.
  MPI_Alltoall(to_ranks_.counts.data(), 1, MPI_INT, from_ranks_.counts.data(), 1, MPI_INT,
               ranks.comm());
  from_ranks_.begins = BeginsOf(from_ranks_.counts);
  // The last begin and the last count give the total.
  const auto total = [](const Communicator::Parts& parts) {
    return static_cast<std::size_t>(parts.begins.back()) +
           static_cast<std::size_t>(parts.counts.back());
  };
  std::vector<Place> received = ranks.SendToEach(std::move(places));
  sent_.resize(total(to_ranks_));
  received_.resize(total(from_ranks_));
  return received;
}

// Finds where each received block is summed. Equal places are made neighbors by sorting; the key
// ends with k, so the order is total.
void BlockShares::PlanSums(const std::vector<Place>& received, Order order) {
  std::int64_t from = 0;
  for (const Place& place : received) {
    terms_.push_back({from, 0, SizeOf(place)});
    from += SizeOf(place);
  }
  std::vector<std::size_t> by_place(received.size());
  std::iota(by_place.begin(), by_place.end(), std::size_t{0});
  const auto key = [&](std::size_t k) {
    return std::make_tuple(received[k].row, received[k].column, k);
  };
  std::sort(by_place.begin(), by_place.end(),
            [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  std::int64_t size = 0;
  for (const std::size_t k : by_place) {
    const Place& place = received[k];
    const bool known = !owned_.empty() && owned_.back().place.row == place.row &&
                       owned_.back().place.column == place.column;
    if (!known) {
      owned_.push_back({place, size});
      size += SizeOf(place);
    }
    // A sum is addressed by the first of its values, rows without padding.
    terms_[k].to = owned_.back().begin;
  }
  sums_.resize(static_cast<std::size_t>(size));
  if (order == Order::kOwnFirst) {
    const auto rank = static_cast<std::size_t>(parts_.ranks.rank());
    const std::int64_t begin = from_ranks_.begins[rank], end = begin + from_ranks_.counts[rank];
    std::stable_partition(terms_.begin(), terms_.end(),
                          [=](const Term& term) { return term.from >= begin && term.from < end; });
  }
}

// Writes the blocks of S in the order of the plan. Values lie row-major without padding, as in a
// batch solve; a transposed share reads a block of columns × rows.
void BlockShares::PackShares() {
  const BlockPattern& pattern = parts_.plans.pattern;
  const double* const S = parts_.elimination.S();
  double* out = sent_.data();
  for (const Share& share : shares_) {
    const double* const block = S + pattern.value_begin[static_cast<std::size_t>(share.block)];
    const int rows = share.place.rows;
    const int columns = share.place.columns;
    for (int r = 0; r < rows; ++r) {
      for (int c = 0; c < columns; ++c) {
        *out++ = share.transposed ? block[c * rows + r] : block[r * columns + c];
      }
    }
  }
}

std::vector<double>& BlockShares::Sum() {
  PackShares();
  parts_.ranks.SendParts(sent_.data(), to_ranks_, received_.data(), from_ranks_);
  std::fill(sums_.begin(), sums_.end(), 0.0);
  for (const Term& term : terms_) {
    const double* const from = received_.data() + term.from;
    double* const to = sums_.data() + term.to;
    for (std::int64_t v = 0; v < term.size; ++v) {
      to[v] += from[v];
    }
  }
  return sums_;
}

std::int64_t BlockShares::Bytes() const {
  return static_cast<std::int64_t>(
      (sent_.size() + received_.size() + sums_.size()) * sizeof(double) +
      shares_.size() * sizeof(Share) + owned_.size() * sizeof(OwnedBlock));
}

}  // namespace inceres::internal
