#pragma once

#include <memory>
#include <vector>

#include "inceres/storage/graph_formats.h"
#include "problem/graph_restorer.h"

namespace inceres::internal {

/// What stands in a file behind its heading, in this order:
///
///     manifolds, losses      each that occurs, once
///     variables              flags, ambient size, manifold
///     state                  their values
///     bounds, pins           of those that have any
///     free variables         removed ones
///     families               each with its factors' variables and losses, and its free places
///     elimination groups     of variables in another one than 0; nothing where there are none
///
/// A failure is the writer's.
void PrintGraph(const FactorGraph& graph, GraphWriter* writer);

/// Reads what PrintGraph wrote; what fits together is left to GraphRestorer. A failure is the
/// reader's.
void ParseGraph(GraphReader* reader, GraphParts* parts,
                std::vector<std::shared_ptr<FactorFamily>>* families);

/// Flags of a variable in a file.
constexpr std::uint8_t kIsLandmark = 1;
constexpr std::uint8_t kIsConstant = 2;
constexpr std::uint8_t kIsRemoved = 4;

}  // namespace inceres::internal
