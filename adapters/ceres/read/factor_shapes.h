#pragma once

#include <vector>

#include "adapters/ceres/read/introspection.h"
#include "inceres/problem/factor_family.h"

namespace inceres::internal {

/// The sizes of a residual block: what blocks must share to be stored in one family.
struct FactorShape {
  int num_residuals = 0;
  std::vector<FactorFamily::Slot> slots;
  /// places number all (shape, slot) pairs: slot s of this shape is place first_place + s
  int first_place = 0;
};

/// The shapes of the residual blocks the solver keeps.
struct ShapeTable {
  std::vector<FactorShape> shapes;
  std::vector<int> shape_of;  ///< per residual block; -1 if fixed
  int num_places = 0;

  const FactorShape& ShapeOf(std::size_t residual) const {
    return shapes[static_cast<std::size_t>(shape_of[residual])];
  }
};

/// Cost: linear in slots; one hash lookup where the shape differs from that of the residual block
/// before.
ShapeTable FindShapes(const ProblemView& view);

}  // namespace inceres::internal
