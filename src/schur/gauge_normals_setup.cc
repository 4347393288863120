// Which factors tell how frames follow their landmarks.
#include <utility>
#include <vector>

#include "base/counting_sort.h"
#include "base/sort_unique.h"
#include "linear/pattern_rows.h"
#include "schur/gauge_normals.h"

namespace inceres::internal {

// The symbolic half of GaugeNormals (docs/algorithms.md, "Reduced linear systems", two levels). The
// modes of the frames solve J_c v = −J_l w in least squares over the factors of Euclidean
// landmarks, so what is set up is: by family and pair of slots, the factors that count, sorted by
// frame; and the pattern of J_cᵀJ_c over these factors, for the sparse Cholesky. Done once for a
// structure.

// A source for each pair of a slot with a Euclidean landmark and another slot that has a frame.
void GaugeNormals::CollectSources() {
  for (const Linearization& cache : evaluator_.families()) {
    for (int p = 0; p < cache.num_slots; ++p) {
      std::vector<std::int32_t> factors;
      for (int i = 0; i < cache.num_factors; ++i) {
        const VariableId id = evaluator_.graph().Variables(cache.id, 0)[cache.Entry(i) + p];
        // Of all landmarks, Euclidean or not: the share decides whether modes are of any use.
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
  // No frame: that of a constant, or a shared one.
  const auto for_each_factor = [&](const auto& add) {
    for (const std::int32_t i : factors) {
      const int frame = FrameThrough(cache, i, slot);
      if (frame >= 0) {
        add(frame, i);
      }
    }
  };
  CountingSort(evaluator_.layout().num_frames, for_each_factor, &source.begin, &source.factors);
  // The slot may belong to shared frames only: such a source would have nothing to say.
  if (!source.factors.empty()) {
    sources_.push_back(std::move(source));
  }
}

// Two frames are coupled if a factor of a source touches both. The diagonal block is there for all
// frames, also for those without such a factor, and is last in its row.
void GaugeNormals::BuildPattern() {
  const Layout& layout = evaluator_.layout();
  pattern_ = PatternWithoutBlocks(
      {layout.packed_offset.begin(), layout.packed_offset.begin() + layout.num_frames + 1});
  std::vector<int> columns;
  for (int row = 0; row < layout.num_frames; ++row) {
    columns.assign(1, row);
    for (const Source& source : sources_) {
      const Linearization& cache = evaluator_.families()[source.family];
      for (int k = source.begin[row]; k < source.begin[row + 1]; ++k) {
        for (int s = 0; s < cache.num_slots; ++s) {
          const int other = FrameThrough(cache, source.factors[k], s);
          // The last one found comes again and again: this keeps the list short before it is
          // sorted.
          if (other >= 0 && other < row && other != columns.back()) {
            columns.push_back(other);
          }
        }
      }
      // After each source, so that the list does not grow beyond what one of them repeats.
      SortUnique(&columns);
    }
    AppendRow(columns, &pattern_);
  }
}

}  // namespace inceres::internal
