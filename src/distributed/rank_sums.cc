#include "distributed/rank_sums.h"

#include <algorithm>

#include "base/sort_unique.h"
#include "linear/pattern_rows.h"

namespace inceres::internal {

// Sums over ranks of arrays that all ranks have whole, but to which each adds in few places: normal
// equations of modes, the coarse matrix VᵀA V, vectors of the coarse space. A rank sends its own
// segments only, to all others; every rank adds what it received in the order of the ranks to
// zeros, and has the same bits as all. So what follows from the sums, a factorization say, need not
// be sent.
//
// Which rank has which segments is exchanged once, by the constructors.

namespace {

// Blocks of all ranks, and the diagonal.
// Every rank gets the list of all and builds the same pattern: sorted by row and column, each block
// once. Diagonal blocks are there even where nobody adds to them, for solvers rely on them.
BlockPattern UnionOf(const Communicator& ranks, const std::vector<int>& sizes,
                     const std::vector<BlockSums::Place>& own) {
  std::vector<int> flat;
  for (const auto& [row, column] : own) {
    flat.push_back(row);
    flat.push_back(column);
  }
  const std::vector<int> all = ranks.GatherAll(flat);
  std::vector<BlockSums::Place> places;
  for (std::size_t k = 0; k < all.size(); k += 2) {
    places.emplace_back(all[k], all[k + 1]);
  }
  for (int i = 0; i < static_cast<int>(sizes.size()); ++i) {
    places.emplace_back(i, i);
  }
  SortUnique(&places);
  std::vector<int> offsets{0};
  for (const int size : sizes) {
    offsets.push_back(offsets.back() + size);
  }
  return PatternOf(std::move(offsets), places);
}

}  // namespace

// Two gatherings: how many segments each rank has, and which.
SegmentSums::SegmentSums(const Communicator& ranks, const std::vector<int>& own) : ranks_(ranks) {
  const std::vector<std::int64_t> counts = ranks.Gather({static_cast<std::int64_t>(own.size())});
  const std::vector<int> all = ranks.GatherAll(own);
  auto next = all.begin();
  for (const std::int64_t count : counts) {
    segments_.emplace_back(next, next + count);
    next += count;
  }
}

// The lengths of all parts follow from `begin`, which all ranks have, and need not be exchanged.
void SegmentSums::Sum(const std::vector<std::int64_t>& begin, double* values) const {
  const auto copy = [&](int s, std::vector<double>* out) {
    out->insert(out->end(), values + begin[s], values + begin[s + 1]);
  };
  std::vector<double> own;
  std::vector<std::int64_t> counts(segments_.size(), 0);
  for (std::size_t r = 0; r < segments_.size(); ++r) {
    for (const int s : segments_[r]) {
      counts[r] += begin[s + 1] - begin[s];
    }
  }
  for (const int s : segments_[ranks_.rank()]) {
    copy(s, &own);
  }
  const std::vector<double> all = ranks_.GatherParts(own, counts);
  // After own values were copied out: segments of nobody become zero.
  std::fill_n(values, begin.back(), 0.0);
  const double* next = all.data();
  // By ascending rank, within a rank by ascending segment: the order of `all`.
  for (const std::vector<int>& of_rank : segments_) {
    for (const int s : of_rank) {
      for (std::int64_t k = begin[s]; k < begin[s + 1]; ++k) {
        values[k] += *next++;
      }
    }
  }
}

std::int64_t SegmentSums::Bytes() const {
  std::size_t count = 0;
  for (const std::vector<int>& of_rank : segments_) {
    count += of_rank.size();
  }
  return static_cast<std::int64_t>(count * sizeof(int));
}

// sums_ reads pattern_, which is declared before it.
BlockSums::BlockSums(const Communicator& ranks, const std::vector<int>& sizes,
                     const std::vector<Place>& own)
    : pattern_(UnionOf(ranks, sizes, own)), sums_(ranks, NumbersOf(own)) {
}

// Ascending, as the segments of SegmentSums; numbers of blocks are segments.
std::vector<int> BlockSums::NumbersOf(const std::vector<Place>& own) const {
  std::vector<int> numbers;
  numbers.reserve(own.size());
  for (const Place& place : own) {
    numbers.push_back(Find(place));
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

// Of a block that no rank has named the result means nothing.
int BlockSums::Find(Place place) const {
  return FindBlock(pattern_, place.first, place.second);
}

std::vector<std::int64_t> SegmentBegins(const std::vector<int>& sizes, std::int64_t scale) {
  std::vector<std::int64_t> begin{0};
  for (const int size : sizes) {
    begin.push_back(begin.back() + scale * size);
  }
  return begin;
}

}  // namespace inceres::internal
