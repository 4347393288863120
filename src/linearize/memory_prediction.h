#pragma once

#include <cstdint>

#include "base/memory_budget.h"
#include "inceres/problem/factor_graph.h"
#include "linearize/linearization.h"

namespace inceres::internal {

/// Throws MemoryExceeded where a family has more of what a solve numbers with 32 bits than can be
/// numbered. `block_quads`: the most of a factor's Jacobian by one slot, or by all. Products are
/// counted where they are planned.
void CheckCounts(std::int64_t num_factors, int num_slots, int residual_size,
                 std::int64_t block_quads);

/// Counts what an evaluator of the graph takes that stores Jacobians so, with its points and the
/// incidences of its landmarks, if they are eliminated; whole rows, which are few, as by slot.
/// Throws MemoryExceeded.
void TakeForGraph(const FactorGraph& graph, bool eliminates_landmarks, JacobianStorage storage,
                  MemoryBudget* budget);

}  // namespace inceres::internal
