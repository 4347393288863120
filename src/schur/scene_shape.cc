#include "schur/scene_shape.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "linear/pattern_rows.h"

namespace inceres::internal {

// What can be said of S, and of iterations with it, from connections alone: PredictSteps compares
// costs by these figures before any plan is made (docs/algorithms.md, "Reduced linear systems"). To
// count the blocks of S costs all products, one by one; a sample of rows and two walks through the
// scene cost little.
//
// The length of a scene stands for how many iterations blocks of S need as a preconditioner: each
// carries a correction one neighbor further.

namespace {

constexpr int kSampledRows = 64;

}  // namespace

SceneShape::SceneShape(const Evaluator& evaluator, const LandmarkIncidences& incidences)
    : layout_(evaluator.layout()),
      incidences_(incidences),
      is_shared_(FindSharedFrames(evaluator)),
      companions_(evaluator, is_shared_) {
  // Jacobians of frames are read twice, by landmarks and by frames; the landmark's own once, and
  // residual-sized t is written and read.
  for (const LandmarkFactors& factors : incidences.factors) {
    double numbers = 2.0 * factors.residual_size;
    for (int s = 0; s < factors.num_slots; ++s) {
      const double passes = s == factors.landmark_slot ? 1.0 : 2.0;
      numbers += passes * factors.residual_size * factors.jacobians[s].row_stride;
    }
    numbers_read_ += factors.count * numbers;
  }
  // The mean: sizes of frames are not told apart here.
  const double frame_size = size() / std::max(1.0, num_frames());
  for (int l = 0; l < incidences.num_landmarks(); ++l) {
    const double count = incidences.begin[l + 1] - incidences.begin[l];
    // Blocks of Y Yᵀ of a landmark, in the lower triangle.
    num_products_ += 0.5 * count * (count + 1.0);
    // Two flops for each entry of each product and each degree of freedom.
    product_flops_ += count * (count + 1.0) * incidences.sizes[l] * frame_size * frame_size;
  }
}

// visit(frame), as often as there are landmarks and factors that couple the two.
template <typename Visit>
void SceneShape::ForEachCoupled(int frame, const Visit& visit) const {
  for (int k = incidences_.frame_begin[frame]; k < incidences_.frame_begin[frame + 1]; ++k) {
    const int l = incidences_.landmarks[incidences_.frame_incidences[k]];
    std::for_each(incidences_.frames.begin() + incidences_.begin[l],
                  incidences_.frames.begin() + incidences_.begin[l + 1], visit);
  }
  std::for_each(companions_.frames.begin() + companions_.begin[frame],
                companions_.frames.begin() + companions_.begin[frame + 1], visit);
}

// Rows at equal distances, so that a sequence is sampled all along. A row counts whole, not its
// lower half, so rows early and late weigh the same.
SceneShape::Sample SceneShape::TakeSample() const {
  const int num_frames = layout_.num_frames;
  const int num_rows = std::min(num_frames, kSampledRows);
  std::vector<int> seen_by(num_frames, -1), seen_in(num_frames, -1);
  double found = 0.0, products = 0.0, writes = 0.0;
  int visit = 0;  // of a row by a chunk
  for (int i = 0; i < num_rows; ++i) {
    // In 64 bits, for i · num_frames may not fit into 32.
    const int row = static_cast<int>(static_cast<std::int64_t>(i) * num_frames / num_rows);
    ForEachCoupled(
        row, [&](int other) { found += std::exchange(seen_by[other], row) != row ? 1.0 : 0.0; });
    int chunk = -1;
    for (int k = incidences_.frame_begin[row]; k < incidences_.frame_begin[row + 1]; ++k) {
      const int l = incidences_.landmarks[incidences_.frame_incidences[k]];
      // Incidences of a frame come sorted by chunk: a new chunk is seen by comparing with the one
      // before.
      visit += std::exchange(chunk, incidences_.ChunkOf(l)) != chunk ? 1 : 0;
      for (int q = incidences_.begin[l]; q < incidences_.begin[l + 1]; ++q) {
        // The first time in this row and chunk; later products of the chunk add to the block in
        // registers.
        writes += std::exchange(seen_in[incidences_.frames[q]], visit) != visit ? 1.0 : 0.0;
      }
      products += incidences_.begin[l + 1] - incidences_.begin[l];
    }
  }
  return {found / std::max(1.0, static_cast<double>(num_rows) * num_frames),
          writes / std::max(1.0, products)};
}

// The first block of a row is the first, in this order, of all that the row's frame is coupled to.
ReducedPrediction SceneShape::PredictEnvelope(const Extent& extent) const {
  const int num_frames = layout_.num_frames;
  std::vector<int> place(num_frames);
  std::vector<int> entries_before(num_frames + 1, 0);  // of each place
  for (int k = 0; k < num_frames; ++k) {
    place[extent.order[k]] = k;
    entries_before[k + 1] = entries_before[k] + layout_.TangentSize(extent.order[k]);
  }
  const auto first_of = [&place](const auto& frames, int begin, int end, int first) {
    return std::accumulate(frames.begin() + begin, frames.begin() + end, first,
                           [&place](int a, int frame) { return std::min(a, place[frame]); });
  };
  const std::vector<int>& begin = incidences_.begin;
  std::vector<int> first_place(incidences_.num_landmarks());
  for (int l = 0; l < incidences_.num_landmarks(); ++l) {
    first_place[l] = first_of(incidences_.frames, begin[l], begin[l + 1], num_frames);
  }
  EnvelopeCost cost;
  for (int frame = 0; frame < num_frames; ++frame) {
    const int own = place[frame];
    int first =
        first_of(companions_.frames, companions_.begin[frame], companions_.begin[frame + 1], own);
    for (int k = incidences_.frame_begin[frame]; k < incidences_.frame_begin[frame + 1]; ++k) {
      first = std::min(first, first_place[incidences_.landmarks[incidences_.frame_incidences[k]]]);
    }
    cost.AddRows(own - first + 1, entries_before[own + 1] - entries_before[first],
                 layout_.TangentSize(frame));
  }
  return cost.prediction();
}

// For the symbolic analysis, where that may decide.
BlockPattern SceneShape::Pattern() const {
  BlockPattern pattern = PatternWithoutBlocks(layout_.FrameOffsets());
  RowColumns columns(layout_.num_frames);
  for (int row = 0; row < layout_.num_frames; ++row) {
    columns.Begin(row);
    ForEachCoupled(row, [&columns](int other) { columns.Add(other); });
    AppendRow(columns.Ascending(), &pattern);
  }
  return pattern;
}

// Breadth first; the last of `reached` is as far away as any, and so far is what is returned.
int SceneShape::GoFrom(int frame, Walk* walk) const {
  // A number for this walk: landmarks are marked with it and need no wiping.
  ++walk->count;
  walk->reached.assign(1, frame);
  walk->level[frame] = 0;
  for (std::size_t next = 0; next < walk->reached.size(); ++next) {
    const int at = walk->reached[next];
    const auto reach = [&](int other) {
      if (is_shared_[other] == 0 && walk->level[other] < 0) {
        // Shared frames are passed over, for all of the scene would be two steps wide.
        walk->level[other] = walk->level[at] + 1;
        walk->reached.push_back(other);
      }
    };
    for (int k = incidences_.frame_begin[at]; k < incidences_.frame_begin[at + 1]; ++k) {
      const int l = incidences_.landmarks[incidences_.frame_incidences[k]];
      // All frames of l were reached from the first one of them: going over it again finds nothing.
      // So a walk costs the incidences once.
      if (std::exchange(walk->spent_in[l], walk->count) != walk->count) {
        std::for_each(incidences_.frames.begin() + incidences_.begin[l],
                      incidences_.frames.begin() + incidences_.begin[l + 1], reach);
      }
    }
    std::for_each(companions_.frames.begin() + companions_.begin[at],
                  companions_.frames.begin() + companions_.begin[at + 1], reach);
  }
  return walk->level[walk->reached.back()];
}

// From any frame to the farthest, and from there to the farthest: two walks. In a tree that is the
// diameter, elsewhere a lower bound. The second walk meets frames in the order of Cuthill and McKee
// but for ties.
SceneShape::Extent SceneShape::FindExtent() const {
  Walk walk;
  walk.level.assign(layout_.num_frames, -1);
  walk.spent_in.assign(incidences_.num_landmarks(), 0);
  Extent extent;
  extent.order.reserve(layout_.num_frames);
  for (int frame = 0; frame < layout_.num_frames; ++frame) {
    if (is_shared_[frame] == 0 && walk.level[frame] < 0) {
      GoFrom(frame, &walk);
      const int far_end = walk.reached.back();
      // Only what this walk has reached, which the second one is to reach again.
      for (const int seen : walk.reached) {
        walk.level[seen] = -1;
      }
      // Its levels stay: what belongs to this piece is not begun with again.
      extent.length = std::max(extent.length, GoFrom(far_end, &walk));
      extent.order.insert(extent.order.end(), walk.reached.begin(), walk.reached.end());
    }
  }
  for (int frame = 0; frame < layout_.num_frames; ++frame) {
    if (is_shared_[frame] != 0) {
      extent.order.push_back(frame);
    }
  }
  return extent;
}

}  // namespace inceres::internal
