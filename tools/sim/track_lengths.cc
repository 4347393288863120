#include "tools/sim/track_lengths.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace inceres::internal {

int DrawTrackLength(double mean, Random* random) {
  const double mean_extra = mean - 2.0;
  if (mean_extra <= 0.0) {
    return 2;
  }
  const double log_continue = PortableLog(mean_extra / (1.0 + mean_extra));
  const double extra = std::floor(PortableLog(1.0 - random->Uniform()) / log_continue);
  return 2 + static_cast<int>(std::min(extra, 1e6));
}

std::int64_t AdjustTrackLengths(std::int64_t total, const std::vector<int>& longest,
                                std::vector<int>* lengths) {
  std::int64_t missing = total - std::accumulate(lengths->begin(), lengths->end(), std::int64_t{0});
  const int step = missing > 0 ? 1 : -1;
  for (bool moved = true; missing != 0 && moved;) {
    moved = false;
    for (std::size_t i = 0; i < lengths->size() && missing != 0; ++i) {
      const int length = (*lengths)[i] + step;
      if (length >= 2 && length <= longest[i]) {
        (*lengths)[i] = length;
        missing -= step;
        moved = true;
      }
    }
  }
  return missing;
}

}  // namespace inceres::internal
