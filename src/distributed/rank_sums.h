#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "distributed/communicator.h"
#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// An array in segments that all ranks have, to some of which each rank adds: what is in no
/// rank's list is zero. Sums are taken in the order of the ranks, by each rank for itself: all have
/// the same bits.
class SegmentSums {
 public:
  /// The segments that this rank adds to, ascending. Collective, as all calls.
  SegmentSums(const Communicator& ranks, const std::vector<int>& own);

  /// values[begin[s]], …: segment s; there is one more of `begin`. In: what this rank adds, in its
  /// own segments; the others may be anything. Out: the sums. Cost: each rank's own segments go to
  /// all others.
  void Sum(const std::vector<std::int64_t>& begin, double* values) const;

  std::int64_t Bytes() const;

 private:
  const Communicator& ranks_;
  std::vector<std::vector<int>> segments_;  // of each rank
};

/// The lower half of a symmetric block matrix that all ranks have, to some of whose blocks each
/// rank adds. Its pattern has those of all ranks, and the diagonal.
class BlockSums {
 public:
  using Place = std::pair<int, int>;  // row, column ≤ row

  /// `own`: the blocks that this rank adds to, in any order. Collective, as all calls.
  BlockSums(const Communicator& ranks, const std::vector<int>& sizes,
            const std::vector<Place>& own);

  const BlockPattern& pattern() const { return pattern_; }
  /// Which block of the pattern it is.
  int Find(Place place) const;
  /// As SegmentSums::Sum, of values by the pattern.
  void Sum(double* values) const { sums_.Sum(pattern_.value_begin, values); }

 private:
  std::vector<int> NumbersOf(const std::vector<Place>& own) const;

  const BlockPattern pattern_;
  const SegmentSums sums_;
};

/// First entry of each segment of these sizes, and their sum.
std::vector<std::int64_t> SegmentBegins(const std::vector<int>& sizes, std::int64_t scale = 1);

}  // namespace inceres::internal
