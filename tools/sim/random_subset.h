#pragma once

#include <cmath>
#include <cstddef>

#include "tools/sim/portable_math.h"

namespace inceres::internal {

/// Calls visit(i) for a share of 0 … size − 1, ascending: exactly the number nearest to fraction ·
/// size, each subset with the same probability (Knuth, The Art of Computer Programming 2, 3.4.2,
/// S). `visit` may draw from `random` too.
template <typename Visit>
void ForRandomSubset(double fraction, std::size_t size, Random* random, Visit&& visit) {
  double wanted = std::floor(fraction * static_cast<double>(size) + 0.5);
  for (std::size_t i = 0; wanted > 0.0; ++i) {
    if (random->Uniform() * static_cast<double>(size - i) < wanted) {
      wanted -= 1.0;
      visit(i);
    }
  }
}

}  // namespace inceres::internal
