#pragma once

#include <cstdint>
#include <vector>

#include "inceres/linear/reduced_matrix.h"
#include "linear/front_tree.h"

namespace inceres::internal {

/// Finds room for S in the memory of its own factor, and sets pattern->value_begin to it, as
/// offsets into that memory. Each block waits where the columns of later fronts will be, and is
/// read when its own front is opened; nothing reads S afterwards. So S takes no memory beside the
/// factor, but must be formed anew for each factorization. Moves the fronts' columns; the sum of
/// their sizes grows by about the blocks of one front for each segment.
void PlaceValuesInFactor(FrontTree* tree, BlockPattern* pattern);

}  // namespace inceres::internal
