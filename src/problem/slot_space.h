#pragma once

#include "inceres/problem/factor_family.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/manifolds.h"

namespace inceres::internal {

/// Whether x ⊞ δ of this manifold is that of the space to first order: then Jacobians in the
/// space's tangent are right for it. The built-in manifold of the space is known at once; any other
/// class, as a wrapper of a user's or a SubsetManifold that holds nothing, is compared by its Plus,
/// at one point without special values. Cost of that: four calls of Plus a degree of freedom.
bool MovesIn(SlotSpace space, const Manifold& manifold);

/// Whether the variable, were it free, would move in the slot's tangent space: with as many degrees
/// of freedom, and as MovesIn says. What Validate does not ask of a constant.
bool CouldMoveInSlot(const FactorGraph& graph, VariableId id, const FactorFamily& family, int slot);

/// "a pose on PoseManifold", for messages.
const char* NameOf(SlotSpace space);

}  // namespace inceres::internal
