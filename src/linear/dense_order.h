#pragma once

#include <vector>

#include "inceres/linear/reduced_solver.h"

namespace inceres::internal {

/// An order of the block rows of S, and where the rows of its Cholesky factor begin in it: what is
/// ahead of the first block that S has in a row stays zero (George & Liu 1981, chapter 4).
struct DenseOrder {
  std::vector<int> blocks;   ///< per place: the block row of the pattern
  std::vector<int> offsets;  ///< per place, and one more: its first scalar row
  /// per place: the first place with a block in its row; itself if none before it has
  std::vector<int> first;
  double flops = 0.0;    ///< of the factorization
  double entries = 0.0;  ///< of the factor that may not be zero
};

/// The order that takes fewer flops of two: the pattern's own, and always next the row that lets
/// the fewest scalar rows enter the front, the rows begun but not done (King 1970). Speeds and
/// biases, which know their neighbors in time only, so come ahead of the poses that all see the
/// same landmarks. Groups of the pattern go before both. Cost: O(blocks² + blocks of S);
/// deterministic.
DenseOrder OrderForEnvelope(const BlockPattern& pattern);

}  // namespace inceres::internal
