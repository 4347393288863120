#pragma once

#include "inceres/problem/factor_family.h"
#include "inceres/problem/manifolds.h"

namespace inceres::internal {

/// M := ∂(x ⊞ δ)/∂δ at x, `count` = ambient × tangent size entries, checked. Returns null, or what is wrong with it: words to
/// follow "PlusJacobian".
const char* EvaluatePlusJacobian(const Manifold& manifold, const double* x, int count, double* M);

/// Sets map->kind from map->plus_jacobian: identity, selection (the indices go to `selection`, tangent_size entries) or dense.
void ClassifyTangentMap(TangentMap* map, int* selection);

}  // namespace inceres::internal
