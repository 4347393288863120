#include "schur/frame_aggregates.h"

#include <algorithm>
#include <utility>

#include "linear/aggregation.h"
#include "linear/pattern_rows.h"
#include "linear/sparse_cholesky.h"
#include "schur/covisibility.h"

namespace inceres::internal {

// Frames in aggregates, and what their columns reach (docs/algorithms.md, "Reduced linear
// systems"). Larger aggregates make a smaller coarse system and a weaker preconditioner. The size
// is taken by cost: rounds of matching double it until the symbolic analysis of the coarse system
// says that its factor is cheap beside the products with S that the iteration takes anyway. Only
// connections are read; aggregates are made once for a structure.
//
// A V has a block for each aggregate and each frame that it reaches: its own frames, frames that
// are tied to these by a block of C or S, and those that see one of its landmarks (of a formed S
// these are among its blocks). AggregateReach lists them once, so that A V has fixed places.

double NumbersReadWithoutS(const LandmarkIncidences& incidences) {
  // Y once in each direction.
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

// What a product with S reads. A formed S has about as many blocks as the graph has entries, each
// edge twice and the diagonal left out, of the mean size of a frame.
double NumbersRead(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                   const WeightedGraph& graph, bool forms_S) {
  if (!forms_S) {
    return NumbersReadWithoutS(incidences);
  }
  const Layout& layout = evaluator.layout();
  const double size = layout.frame_size() / std::max(1.0, static_cast<double>(layout.num_frames));
  return size * size * static_cast<double>(graph.neighbors.size());
}

// The coarse system that these parts would have: a block of kModes columns a part, coupled as the
// parts are.
BlockPattern PatternOf(const WeightedGraph& graph) {
  std::vector<int> offsets{0};
  for (int i = 0; i < graph.num_vertices(); ++i) {
    offsets.push_back(offsets.back() + kModes);
  }
  BlockPattern pattern = PatternWithoutBlocks(std::move(offsets));
  std::vector<int> columns;
  for (int i = 0; i < graph.num_vertices(); ++i) {
    columns.clear();
    // Neighbors ascend: those before i are the lower triangle.
    for (int k = graph.begin[i]; k < graph.begin[i + 1] && graph.neighbors[k] < i; ++k) {
      columns.push_back(graph.neighbors[k]);
    }
    columns.push_back(i);
    AppendRow(columns, &pattern);
  }
  return pattern;
}

// A symbolic analysis, without numbers. Where it fails the system is not cheap.
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
  count = clusters.num_clusters();
}

// Cost: the incidences of each aggregate's landmarks, once an aggregate that sees them.
AggregateReach::AggregateReach(const FrameAggregates& aggregates, std::vector<int> widths,
                               const LandmarkIncidences& incidences, const BlockPattern& pattern) {
  const std::vector<int>& part_of = aggregates.clusters.cluster_of;
  const int num_frames = static_cast<int>(part_of.size());
  std::vector<std::vector<int>> members(aggregates.count);
  std::vector<std::vector<int>> direct(aggregates.count);  // frames by blocks of the pattern
  for (int i = 0; i < num_frames; ++i) {
    members[part_of[i]].push_back(i);
  }
  // Both ways, for the pattern is a lower triangle. The diagonal block makes an aggregate reach its
  // own frames.
  ForEachBlock(pattern, [&](int i, int j, int /*block*/) {
    direct[part_of[i]].push_back(j);
    direct[part_of[j]].push_back(i);
  });
  shape.aggregate_of = part_of;
  shape.widths = std::move(widths);
  shape.coupled_begin.push_back(0);
  landmarks_begin.push_back(0);
  // Marks with the number of the aggregate that has been there last: nothing to wipe between
  // aggregates.
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
    // Ascending, which CoarseShape asks for; so are the landmarks, whose order is that of the sums
    // in A V.
    std::sort(shape.coupled.begin() + shape.coupled_begin.back(), shape.coupled.end());
    std::sort(landmarks.begin() + landmarks_begin.back(), landmarks.end());
    shape.coupled_begin.push_back(static_cast<int>(shape.coupled.size()));
    landmarks_begin.push_back(static_cast<int>(landmarks.size()));
  }
}

}  // namespace inceres::internal
