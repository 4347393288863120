#pragma once

#include <cstdint>

#include "base/memory_budget.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/linearization.h"

namespace inceres::internal {

/// How many there are of what a solve numbers with 32 bits, in one family.
struct FamilyCounts {
  std::int64_t num_factors = 0;
  int num_slots = 0;
  int residual_size = 0;
  std::int64_t largest_block_quads = 0;  ///< of a factor's Jacobian by one slot, or by all
};

/// Throws MemoryExceeded where there are more than can be numbered. Products are counted where they
/// are planned.
void CheckCounts(const FamilyCounts& counts);

/// Counts what an evaluator of the graph takes that stores Jacobians so, with its points and the
/// incidences of its landmarks, if they are eliminated; whole rows, which are few, as by slot.
/// Throws MemoryExceeded.
void TakeForGraph(const FactorGraph& graph, bool eliminates_landmarks, JacobianStorage storage,
                  MemoryBudget* budget);

}  // namespace inceres::internal
