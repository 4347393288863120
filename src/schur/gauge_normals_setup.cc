// Which factors tell how frames follow their landmarks.
#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "schur/gauge_normals.h"

namespace inceres::internal {

void GaugeNormals::CollectSources() {
  for (const Linearization& cache : evaluator_.families()) {
    for (int p = 0; p < cache.num_slots; ++p) {
      std::vector<std::int32_t> factors;
      for (int i = 0; i < cache.num_factors; ++i) {
        const VariableId id = evaluator_.graph().Variables(cache.id, 0)[cache.Entry(i) + p];
        num_of_landmarks_ += evaluator_.layout().LandmarkOf(id) >= 0 ? 1.0 : 0.0;
        if (LandmarkThrough(cache, i, p) >= 0) {
          factors.push_back(i);
        }
      }
      num_of_points_ += static_cast<double>(factors.size());
      for (int s = 0; !factors.empty() && s < cache.num_slots; ++s) {
        if (s != p) {
          AddSource(cache, s, p, factors);
        }
      }
    }
  }
}

void GaugeNormals::AddSource(const Linearization& cache, int slot, int landmark_slot,
                             const std::vector<std::int32_t>& factors) {
  Source source{cache.id, slot, landmark_slot, {}, {}};
  source.begin.assign(evaluator_.layout().num_frames + 1, 0);
  for (const std::int32_t i : factors) {
    const int frame = FrameThrough(cache, i, slot);
    source.begin[frame + 1] += frame >= 0 ? 1 : 0;
  }
  std::partial_sum(source.begin.begin(), source.begin.end(), source.begin.begin());
  source.factors.resize(source.begin.back());
  std::vector<int> next(source.begin.begin(), source.begin.end() - 1);
  for (const std::int32_t i : factors) {
    const int frame = FrameThrough(cache, i, slot);
    if (frame >= 0) {
      source.factors[next[frame]++] = i;
    }
  }
  if (!source.factors.empty()) {
    sources_.push_back(std::move(source));
  }
}

void GaugeNormals::BuildPattern() {
  const Layout& layout = evaluator_.layout();
  pattern_.offsets.assign(layout.packed_offset.begin(),
                          layout.packed_offset.begin() + layout.num_frames + 1);
  pattern_.row_begin.push_back(0);
  pattern_.value_begin.push_back(0);
  std::vector<int> columns;
  for (int row = 0; row < layout.num_frames; ++row) {
    columns.assign(1, row);
    for (const Source& source : sources_) {
      const Linearization& cache = evaluator_.families()[source.family];
      for (int k = source.begin[row]; k < source.begin[row + 1]; ++k) {
        for (int s = 0; s < cache.num_slots; ++s) {
          const int other = FrameThrough(cache, source.factors[k], s);
          if (other >= 0 && other < row && other != columns.back()) {
            columns.push_back(other);
          }
        }
      }
      std::sort(columns.begin(), columns.end());
      columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
    }
    for (const int column : columns) {
      pattern_.columns.push_back(column);
      pattern_.value_begin.push_back(pattern_.value_begin.back() +
                                     static_cast<std::int64_t>(pattern_.block_size(row)) *
                                         pattern_.block_size(column));
    }
    pattern_.row_begin.push_back(static_cast<int>(pattern_.columns.size()));
  }
}

}  // namespace inceres::internal
