#include "schur/frame_aggregates.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "linear/aggregation.h"
#include "linear/pattern_rows.h"
#include "linear/sparse_cholesky.h"
#include "schur/covisibility.h"

namespace inceres::internal {

double NumbersReadWithoutS(const LandmarkIncidences& incidences) {
  return 2.0 * kQuad * static_cast<double>(incidences.y_quads);
}

namespace {

constexpr int kFirstRound = 3;  // 2³ frames an aggregate
constexpr int kModes = 7;       // for predictions
// A product with S reads some numbers. A coarse factor is cheap if it has no more than this share
// of them, for it is read four times an iteration, and takes no more than this many flops for each,
// as much as some hundred products.
constexpr double kEntriesPerNumberRead = 0.25;
constexpr double kFlopsPerNumberRead = 256.0;

double NumbersRead(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                   const WeightedGraph& graph, bool forms_S) {
  if (!forms_S) {
    return NumbersReadWithoutS(incidences);
  }
  const Layout& layout = evaluator.layout();
  const double size = layout.frame_size() / std::max(1.0, static_cast<double>(layout.num_frames));
  return size * size * static_cast<double>(graph.neighbors.size());
}

BlockPattern PatternOf(const WeightedGraph& graph) {
  std::vector<int> offsets{0};
  for (int i = 0; i < graph.num_vertices(); ++i) {
    offsets.push_back(offsets.back() + kModes);
  }
  BlockPattern pattern = PatternWithoutBlocks(std::move(offsets));
  std::vector<int> columns;
  for (int i = 0; i < graph.num_vertices(); ++i) {
    columns.clear();
    for (int k = graph.begin[i]; k < graph.begin[i + 1] && graph.neighbors[k] < i; ++k) {
      columns.push_back(graph.neighbors[k]);
    }
    columns.push_back(i);
    AppendRow(columns, &pattern);
  }
  return pattern;
}

bool IsCheap(const WeightedGraph& graph, double numbers_read, const Executor& executor) {
  const BlockPattern pattern = PatternOf(graph);
  SparseCholesky coarse(executor);
  return coarse.Predict(pattern).ok() &&
         coarse.PredictedEntries() <= kEntriesPerNumberRead * numbers_read &&
         coarse.PredictedFlops() <= kFlopsPerNumberRead * numbers_read;
}

}  // namespace

FrameAggregates::FrameAggregates(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                                 bool forms_S)
    : is_shared(FindSharedFrames(evaluator)) {
  const WeightedGraph graph = CovisibilityGraph(evaluator, incidences, is_shared);
  Join(graph, NumbersRead(evaluator, incidences, graph, forms_S), evaluator.executor());
}

void FrameAggregates::Join(const WeightedGraph& covisibility, double numbers_read,
                           const Executor& executor) {
  clusters.cluster_of =
      AggregateByMatching(covisibility, kFirstRound, [&](const WeightedGraph& parts) {
        return IsCheap(parts, numbers_read, executor);
      }).part_of;
  for (const int part : clusters.cluster_of) {
    count = std::max(count, part + 1);
  }
}

AggregateReach::AggregateReach(const FrameAggregates& aggregates, std::vector<int> widths,
                               const LandmarkIncidences& incidences, const BlockPattern& pattern) {
  const std::vector<int>& part_of = aggregates.clusters.cluster_of;
  const int num_frames = static_cast<int>(part_of.size());
  std::vector<std::vector<int>> members(aggregates.count);
  std::vector<std::vector<int>> direct(aggregates.count);  // frames by blocks of the pattern
  for (int i = 0; i < num_frames; ++i) {
    members[part_of[i]].push_back(i);
    for (int k = pattern.row_begin[i]; k < pattern.row_begin[i + 1]; ++k) {
      direct[part_of[i]].push_back(pattern.columns[k]);
      direct[part_of[pattern.columns[k]]].push_back(i);
    }
  }
  shape.aggregate_of = part_of;
  shape.widths = std::move(widths);
  shape.coupled_begin.push_back(0);
  landmarks_begin.push_back(0);
  std::vector<int> seen_by(incidences.num_landmarks(), -1);
  std::vector<int> reached_by(num_frames, -1);
  for (int a = 0; a < aggregates.count; ++a) {
    const auto reach = [&](int frame) {
      if (std::exchange(reached_by[frame], a) != a) {
        shape.coupled.push_back(frame);
      }
    };
    std::for_each(direct[a].begin(), direct[a].end(), reach);
    for (const int i : members[a]) {
      for (int k = incidences.frame_begin[i]; k < incidences.frame_begin[i + 1]; ++k) {
        const int l = incidences.landmarks[incidences.frame_incidences[k]];
        if (std::exchange(seen_by[l], a) != a) {
          landmarks.push_back(l);
          std::for_each(incidences.frames.begin() + incidences.begin[l],
                        incidences.frames.begin() + incidences.begin[l + 1], reach);
        }
      }
    }
    std::sort(shape.coupled.begin() + shape.coupled_begin.back(), shape.coupled.end());
    std::sort(landmarks.begin() + landmarks_begin.back(), landmarks.end());
    shape.coupled_begin.push_back(static_cast<int>(shape.coupled.size()));
    landmarks_begin.push_back(static_cast<int>(landmarks.size()));
  }
}

}  // namespace inceres::internal
