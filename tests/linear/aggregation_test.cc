// Groups of vertices that hang together.
#include "linear/aggregation.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

WeightedGraph GraphOf(int num_vertices, const std::map<std::pair<int, int>, double>& edges) {
  WeightedGraph graph;
  for (int i = 0; i < num_vertices; ++i) {
    for (int j = 0; j < num_vertices; ++j) {
      const auto found = edges.find({std::min(i, j), std::max(i, j)});
      if (i != j && found != edges.end()) {
        graph.neighbors.push_back(j);
        graph.weights.push_back(found->second);
      }
    }
    graph.begin.push_back(static_cast<int>(graph.neighbors.size()));
  }
  return graph;
}

std::map<std::pair<int, int>, double> Path(int first, int last) {
  std::map<std::pair<int, int>, double> edges;
  for (int i = first; i < last; ++i) {
    edges[{i, i + 1}] = 10.0;
    if (i + 2 <= last) {
      edges[{i, i + 2}] = 4.0;
    }
  }
  return edges;
}

std::vector<int> SizesOf(const Aggregates& aggregates) {
  std::vector<int> sizes(static_cast<std::size_t>(aggregates.graph.num_vertices()), 0);
  for (const int part : aggregates.part_of) {
    ++sizes[static_cast<std::size_t>(part)];
  }
  return sizes;
}

bool Always(const WeightedGraph& /*graph*/) {
  return true;
}

TEST(Aggregation, CutsAPathIntoPiecesOfTheRoundsSize) {
  const Aggregates aggregates = AggregateByMatching(GraphOf(96, Path(0, 95)), 3, Always);
  const std::vector<int> sizes = SizesOf(aggregates);
  EXPECT_GE(*std::min_element(sizes.begin(), sizes.end()), 4);
  EXPECT_LE(*std::max_element(sizes.begin(), sizes.end()), 20);
  for (std::size_t v = 1; v < aggregates.part_of.size(); ++v) {  // pieces, in order
    EXPECT_GE(aggregates.part_of[v], aggregates.part_of[v - 1]);
    EXPECT_LE(aggregates.part_of[v], aggregates.part_of[v - 1] + 1);
  }
}

TEST(Aggregation, GoesOnUntilTheGraphIsSmallEnough) {
  const auto is_small = [](const WeightedGraph& parts) { return parts.num_vertices() <= 3; };
  const Aggregates aggregates = AggregateByMatching(GraphOf(96, Path(0, 95)), 1, is_small);
  EXPECT_LE(aggregates.graph.num_vertices(), 3);
  EXPECT_GE(aggregates.graph.num_vertices(), 2);
}

TEST(Aggregation, LeavesApartWhatNothingTies) {
  auto edges = Path(0, 9);
  edges.merge(Path(10, 19));
  const Aggregates aggregates = AggregateByMatching(GraphOf(23, edges), 20, Always);
  EXPECT_EQ(aggregates.graph.num_vertices(), 5);  // two paths, three by themselves
  EXPECT_NE(aggregates.part_of[9], aggregates.part_of[10]);
  EXPECT_EQ(aggregates.part_of[0], aggregates.part_of[9]);
  EXPECT_EQ(SizesOf(aggregates)[static_cast<std::size_t>(aggregates.part_of[21])], 1);
}

TEST(Aggregation, TakesTheStrongestTies) {
  std::map<std::pair<int, int>, double> edges;
  for (int i = 0; i < 12; i += 2) {  // strong pairs along a weak path
    edges[{i, i + 1}] = 50.0;
    if (i > 0) {
      edges[{i - 1, i}] = 1.0;
    }
  }
  const Aggregates aggregates = AggregateByMatching(GraphOf(12, edges), 1, Always);
  for (int i = 0; i < 12; i += 2) {
    EXPECT_EQ(aggregates.part_of[static_cast<std::size_t>(i)],
              aggregates.part_of[static_cast<std::size_t>(i) + 1]);
  }
  EXPECT_EQ(aggregates.graph.num_vertices(), 6);
}

TEST(Aggregation, DoesNotHangAStarOnItsHub) {
  std::map<std::pair<int, int>, double> edges;
  for (int i = 1; i < 200; ++i) {
    edges[{0, i}] = 1.0;
  }
  const std::vector<int> sizes = SizesOf(AggregateByMatching(GraphOf(200, edges), 4, Always));
  EXPECT_LE(*std::max_element(sizes.begin(), sizes.end()), 20);
}

}  // namespace
}  // namespace inceres::internal
