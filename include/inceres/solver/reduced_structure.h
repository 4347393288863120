#pragma once

#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres {

/// The block sparsity of the reduced system S of an IncrementalSolver, and where its last Update changed it. For pictures and
/// for understanding what an Update costs; the numbers themselves stay inside.
struct ReducedStructure {
  /// A block below the diagonal: row > column. Stored, so it may have become zero: blocks go when one of their frames does.
  struct Block {
    int row;
    int column;
  };
  /// The frame of each block row, in order of arrival: the order in which the resumed Cholesky eliminates them too until loops
  /// have aged it. −1: a frame was removed and its row is not in use again yet. A frame that is held constant keeps its row.
  std::vector<VariableId> frames;
  /// Sorted by row, then by column.
  std::vector<Block> blocks;
  /// Per block row: the last Update, or an edit since the one before, added to its blocks or took from them. A block changed
  /// only if both of its rows did.
  std::vector<bool> changed;
};

}  // namespace inceres
