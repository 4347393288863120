#pragma once

#include "inceres/problem/factor_family.h"

namespace inceres::internal {

/// Sets map->kind from map->plus_jacobian: identity, selection (the indices go to `selection`,
/// tangent_size entries) or dense.
void ClassifyTangentMap(TangentMap* map, int* selection);

}  // namespace inceres::internal
