#include "distributed/ranked_aggregates.h"

#include <algorithm>
#include <tuple>
#include <vector>

#include "schur/covisibility.h"

namespace inceres::internal {

// Aggregates of frames for the two-level preconditioner when no rank sees all of what ties frames
// together (docs/algorithms.md, "Reduced linear systems", two levels). Ties are counts: landmarks
// that two frames both see and factors that touch both. Each landmark and each factor is on one
// rank, so counts of ranks add up; every rank gathers the weighted graph of all, and finds the same
// aggregates in it by itself.
//
// In three rounds: factors of each frame, which tell the shared frames with a second count that
// needs the first one of all ranks; then the graph without shared frames; then the matching, with
// the work of a product with S summed over ranks. Done once for a structure.

namespace {

// By the numbers of frames, each edge at both of its ends.
struct Edge {
  int from;
  int to;
  double weight;
};

// Counts per frame here, summed over all ranks: per frame of all.
std::vector<double> SumByFrame(const SharedFrames& frames, const SegmentSums& by_frame,
                               const std::vector<double>& here) {
  std::vector<double> all(frames.sizes().size(), 0.0);
  for (std::size_t i = 0; i < here.size(); ++i) {
    // Frames that this rank does not have are of segments that it does not add to.
    all[frames.moving()[i].number] = here[i];
  }
  by_frame.Sum(SegmentBegins(std::vector<int>(all.size(), 1)), all.data());
  return all;
}

// All edges of all ranks, by their ends. Equal edges of several ranks stay next to each other, in
// any order.
std::vector<Edge> GatherEdges(const Communicator& ranks, const SharedFrames& frames,
                              const WeightedGraph& here) {
  std::vector<Edge> own;
  for (int i = 0; i < here.num_vertices(); ++i) {
    for (int k = here.begin[i]; k < here.begin[i + 1]; ++k) {
      own.push_back(
          {frames.moving()[i].number, frames.moving()[here.neighbors[k]].number, here.weights[k]});
    }
  }
  std::vector<Edge> all = ranks.GatherAll(own);
  std::sort(all.begin(), all.end(), [](const Edge& a, const Edge& b) {
    return std::tie(a.from, a.to) < std::tie(b.from, b.to);
  });
  return all;
}

// Weights are whole numbers: their sums have no order.
// Compressed rows: the edges are sorted, so those of a vertex come together, and equal neighbors
// too.
WeightedGraph SumGraphs(const Communicator& ranks, const SharedFrames& frames,
                        const WeightedGraph& here) {
  WeightedGraph graph;
  const std::vector<Edge> edges = GatherEdges(ranks, frames, here);
  auto next = edges.begin();
  for (int i = 0; i < static_cast<int>(frames.sizes().size()); ++i) {
    for (; next != edges.end() && next->from == i; ++next) {
      // graph.begin.back() is where the row of i begins: an equal neighbor before it is of another
      // row.
      const bool is_new = static_cast<int>(graph.neighbors.size()) == graph.begin.back() ||
                          graph.neighbors.back() != next->to;
      if (is_new) {
        graph.neighbors.push_back(next->to);
        graph.weights.push_back(next->weight);
      } else {
        graph.weights.back() += next->weight;
      }
    }
    graph.begin.push_back(static_cast<int>(graph.neighbors.size()));
  }
  return graph;
}

// Ascending, as SegmentSums takes them; the layout may have another order.
std::vector<int> NumbersOf(const SharedFrames& frames) {
  std::vector<int> numbers;
  for (const FramePlace& place : frames.moving()) {
    numbers.push_back(place.number);
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

template <typename T>
std::vector<T> AtFramesHere(const SharedFrames& frames, const std::vector<T>& all) {
  std::vector<T> here;
  for (const FramePlace& place : frames.moving()) {
    here.push_back(all[place.number]);
  }
  return here;
}

}  // namespace

// Collective. The matching itself runs on each rank with the same input, by integers and sums of
// whole numbers: the same aggregates.
RankedAggregates::RankedAggregates(const Communicator& ranks, const SharedFrames& frames,
                                   const Evaluator& evaluator, const LandmarkIncidences& incidences)
    : by_frame(ranks, NumbersOf(frames)) {
  const std::vector<double> factors = SumByFrame(frames, by_frame, CountFactorsOfFrames(evaluator));
  const std::vector<double> beside_few =
      SumByFrame(frames, by_frame, CountFactorsBesideFew(evaluator, AtFramesHere(frames, factors)));
  all.is_shared = FindSharedFrames(factors, beside_few);
  here.is_shared = AtFramesHere(frames, all.is_shared);
  const WeightedGraph graph =
      SumGraphs(ranks, frames, CovisibilityGraph(evaluator, incidences, here.is_shared));
  all.Join(graph, ranks.Sum(NumbersReadWithoutS(incidences)), evaluator.executor());
  here.count = all.count;
  here.clusters.cluster_of = AtFramesHere(frames, all.clusters.cluster_of);
  // A number for each pair of aggregate and owner: the fine part keeps blocks within these.
  for (std::size_t i = 0; i < frames.moving().size(); ++i) {
    by_owner.cluster_of.push_back(here.clusters.cluster_of[i] * ranks.size() +
                                  frames.moving()[i].owner);
  }
}

}  // namespace inceres::internal
