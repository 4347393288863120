#pragma once

#include <limits>

namespace inceres::internal {

/// Of the cost at which a solve begins: what its steps can have left by their own rounding. Each is
/// known to 16 ε of its length, and so are the residuals that it has taken away. Whatever they are
/// made of, what is left of a cost that has fallen so far is not worked on.
inline constexpr double kRoundingOfSteps =
    256.0 * std::numeric_limits<double>::epsilon() * std::numeric_limits<double>::epsilon();

}  // namespace inceres::internal
