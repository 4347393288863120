#include "distributed/rank_sums.h"

#include <algorithm>
#include <cstring>

#include "linear/pattern_rows.h"

namespace inceres::internal {
namespace {

template <typename T>
std::vector<char> ToBytes(const std::vector<T>& values) {
  std::vector<char> bytes(values.size() * sizeof(T));
  if (!values.empty()) {
    std::memcpy(bytes.data(), values.data(), bytes.size());
  }
  return bytes;
}

std::vector<int> ToInts(const std::vector<char>& bytes) {
  std::vector<int> values(bytes.size() / sizeof(int));
  if (!values.empty()) {
    std::memcpy(values.data(), bytes.data(), bytes.size());
  }
  return values;
}

// Blocks of all ranks, and the diagonal.
BlockPattern UnionOf(const Communicator& ranks, const std::vector<int>& sizes,
                     const std::vector<BlockSums::Place>& own) {
  std::vector<int> flat;
  for (const auto& [row, column] : own) {
    flat.push_back(row);
    flat.push_back(column);
  }
  const std::vector<int> all = ToInts(ranks.GatherBytes(ToBytes(flat)));
  std::vector<BlockSums::Place> places;
  for (std::size_t k = 0; k < all.size(); k += 2) {
    places.emplace_back(all[k], all[k + 1]);
  }
  for (int i = 0; i < static_cast<int>(sizes.size()); ++i) {
    places.emplace_back(i, i);
  }
  std::sort(places.begin(), places.end());
  places.erase(std::unique(places.begin(), places.end()), places.end());
  std::vector<int> offsets{0};
  for (const int size : sizes) {
    offsets.push_back(offsets.back() + size);
  }
  BlockPattern pattern = PatternWithoutBlocks(std::move(offsets));
  std::vector<int> columns;
  for (const auto& [row, column] : places) {
    columns.push_back(column);
    if (row == column) {  // the last one of its row
      AppendRow(columns, &pattern);
      columns.clear();
    }
  }
  return pattern;
}

}  // namespace

SegmentSums::SegmentSums(const Communicator& ranks, const std::vector<int>& own) : ranks_(ranks) {
  const std::vector<std::int64_t> counts = ranks.Gather({static_cast<std::int64_t>(own.size())});
  const std::vector<int> all = ToInts(ranks.GatherBytes(ToBytes(own)));
  auto next = all.begin();
  for (const std::int64_t count : counts) {
    segments_.emplace_back(next, next + count);
    next += count;
  }
}

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
  std::fill_n(values, begin.back(), 0.0);
  const double* next = all.data();
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

BlockSums::BlockSums(const Communicator& ranks, const std::vector<int>& sizes,
                     const std::vector<Place>& own)
    : pattern_(UnionOf(ranks, sizes, own)), sums_(ranks, NumbersOf(own)) {
}

std::vector<int> BlockSums::NumbersOf(const std::vector<Place>& own) const {
  std::vector<int> numbers;
  numbers.reserve(own.size());
  for (const Place& place : own) {
    numbers.push_back(Find(place));
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

int BlockSums::Find(Place place) const {
  const auto first = pattern_.columns.begin() + pattern_.row_begin[place.first];
  const auto last = pattern_.columns.begin() + pattern_.row_begin[place.first + 1];
  return static_cast<int>(std::lower_bound(first, last, place.second) - pattern_.columns.begin());
}

std::vector<std::int64_t> SegmentBegins(const std::vector<int>& sizes, std::int64_t scale) {
  std::vector<std::int64_t> begin{0};
  for (const int size : sizes) {
    begin.push_back(begin.back() + scale * size);
  }
  return begin;
}

}  // namespace inceres::internal
