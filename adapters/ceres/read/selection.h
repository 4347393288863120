#pragma once

#include <optional>
#include <vector>

#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// The values that a block's tangent vector moves, each by one of its entries and in their order,
/// if that is all its manifold does: x ⊞ δ adds δ to them and leaves the rest, as SubsetManifold
/// and EuclideanManifold do. None of any other manifold. The user's PlusJacobian and Plus are
/// called once, at the block's values; of a block without a manifold nothing is.
std::optional<std::vector<int>> MovedValues(const ParameterBlockView& block);

/// The first variable block with bounds whose manifold does anything else; null if there is none.
/// There a bound of a value is none of a step.
const ParameterBlockView* FindBoundsOnManifold(const ProblemView& view);
/// Whether any variable block has bounds.
bool HasBounds(const ProblemView& view);

}  // namespace inceres::internal
