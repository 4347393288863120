#pragma once

#include <type_traits>

namespace inceres::internal {

/// Calls visit(size), with a std::integral_constant where the size is 1 to 4 or 6: loops over a
/// size that is a constant are unrolled, and do the same operations in the same order.
template <typename Visit>
auto WithConstantSize(int size, const Visit& visit) {
  switch (size) {
    case 1:
      return visit(std::integral_constant<int, 1>());
    case 2:
      return visit(std::integral_constant<int, 2>());
    case 3:
      return visit(std::integral_constant<int, 3>());
    case 4:
      return visit(std::integral_constant<int, 4>());
    case 6:
      return visit(std::integral_constant<int, 6>());
    default:
      return visit(size);
  }
}

}  // namespace inceres::internal
