// Start values of pose graphs: without any, from the edges alone.
#include "inceres/io/pose_graph_start.h"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/io/g2o_graph.h"
#include "inceres/solver/solver.h"
#include "support/pose_graph_world.h"

namespace inceres {
namespace {

using test::PoseGraphWorld;

double LargestTurn(const PoseGraph& a, const PoseGraph& b) {
  double largest = 0.0;
  for (int i = 0; i < a.NumVertices(); ++i) {
    const double *x = a.PoseData(i), *y = b.PoseData(i);
    double turn = 0.0;
    if (a.dimension == 2) {
      turn = std::fabs(std::remainder(x[2] - y[2], 2.0 * M_PI));
    } else {
      double conjugate[4], q[4], phi[3];
      ConjugateQuaternion(x + 3, conjugate);
      MultiplyQuaternions(conjugate, y + 3, q);
      LogQuaternion(q, phi);
      turn = std::sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]);
    }
    largest = std::max(largest, turn);
  }
  return largest;
}

TEST(ChordalStart, OfNothingIsRefused) {
  for (const int dimension : {2, 3}) {
    PoseGraph nothing;
    nothing.dimension = dimension;
    const Status status = StartByChordalRelaxation(&nothing);
    EXPECT_EQ(status.message, "chordal start: the graph has no vertices");
  }
}

// Made by hand: the starts would read and write out of range.
TEST(PoseGraphStart, OfAGraphThatDoesNotFitTogetherIsRefused) {
  const auto expect_refused = [](PoseGraph graph, const std::string& message) {
    const std::vector<double> before = graph.poses;
    const Status all[] = {StartAlongSpanningTree(&graph), StartByChordalRelaxation(&graph),
                          ChordalGncStart(graph, G2oGraph(), {})({}, nullptr)};
    for (const Status& status : all) {
      EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
      EXPECT_EQ(status.message, message);
    }
    EXPECT_EQ(graph.poses, before);
  };
  for (const int dimension : {2, 3}) {
    const PoseGraph good = PoseGraphWorld(dimension, 12, 5, 0, 0.1, 1).truth;
    PoseGraph bad = good;
    bad.poses.clear();
    expect_refused(
        bad, "PoseGraph: poses has 0 values instead of " + std::to_string(12 * good.PoseSize()));
    bad = good;
    bad.edges[3].to = 12;
    expect_refused(bad, "PoseGraph: edges[3] has an end that is no vertex");
    bad = good;
    bad.edges[2].from = -1;
    expect_refused(bad, "PoseGraph: edges[2] has an end that is no vertex");
  }
}

// An edge that leads nowhere joins no neighbors: it is suspected, and AddPoseGraph names it.
TEST(PoseGraphStart, AnEdgeWithoutAVertexAtItsEndIsALoop) {
  PoseGraph graph = PoseGraphWorld(2, 12, 12, 0, 0.1, 1).truth;
  EXPECT_TRUE(LoopEdges(graph).empty());
  graph.edges[3].to = 12;
  graph.edges[5].from = -1;
  EXPECT_EQ(LoopEdges(graph), (std::vector<int>{3, 5}));
}

// Of two graphs that were mixed: the start would write weights and values out of range.
TEST(ChordalGncStart, NamesWhatIsNotOfItsGraph) {
  for (const int dimension : {2, 3}) {
    const PoseGraph poses = PoseGraphWorld(dimension, 12, 5, 0, 0.0, 1).truth;
    const std::string num_edges = std::to_string(poses.edges.size());
    FactorGraph graph;
    G2oGraph ids;
    ASSERT_TRUE(AddPoseGraph(poses, nullptr, &graph, &ids).ok());
    const std::vector<double> before = graph.state();
    const auto expect_refused = [&](const G2oGraph& given, const std::vector<int>& suspects,
                                    FactorGraph* target, const std::string& message) {
      const Status status = ChordalGncStart(poses, given, suspects)(
          std::vector<double>(suspects.size(), 1.0), target);
      EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
      EXPECT_EQ(status.message, "chordal start: " + message);
    };
    expect_refused(ids, {0, -1}, &graph,
                   "suspected_edges[1] is -1, the pose graph has " + num_edges + " edges");
    expect_refused(
        ids, {static_cast<int>(poses.edges.size())}, &graph,
        "suspected_edges[0] is " + num_edges + ", the pose graph has " + num_edges + " edges");
    expect_refused(G2oGraph(), {}, &graph, "ids has 0 poses, the pose graph 12 vertices");
    G2oGraph more = ids;
    more.poses.push_back(0);
    expect_refused(more, {}, &graph, "ids has 13 poses, the pose graph 12 vertices");
    G2oGraph other = ids;
    other.poses[11] = 12;
    expect_refused(other, {}, &graph, "variable 12 is no pose of the graph");
    FactorGraph smaller;
    smaller.AddVariable(before.data(), 2, Role::kFrame);
    expect_refused(ids, {}, &smaller, "variable 0 is no pose of the graph");
    EXPECT_EQ(graph.state(), before);
    EXPECT_TRUE(ChordalGncStart(poses, ids, {0})({1.0}, &graph).ok());
  }
}

TEST(ChordalStart, IsExactWithoutNoise) {
  for (const int dimension : {2, 3}) {
    const PoseGraphWorld world(dimension, 100, 25, 0, 0.0, 1);
    PoseGraph start = world.WithoutPlaces();
    ASSERT_TRUE(StartByChordalRelaxation(&start).ok());
    EXPECT_LT(PoseGraphWorld::LargestDistance(start, world.truth), 1e-8) << dimension;
    EXPECT_LT(LargestTurn(start, world.truth), 1e-9) << dimension;
  }
}

TEST(ChordalStart, IsNearTheMinimumWithNoise) {
  for (const int dimension : {2, 3}) {
    const PoseGraphWorld world(dimension, 150, 30, 0, 0.03, 2);
    PoseGraph start = world.WithoutPlaces();
    ASSERT_TRUE(StartByChordalRelaxation(&start).ok());
    FactorGraph graph;
    G2oGraph ids;
    ASSERT_TRUE(AddPoseGraph(start, nullptr, &graph, &ids).ok());
    graph.SetConstant(ids.poses[0], true);
    const Summary summary = Solve(SolverOptions(), &graph);
    EXPECT_LT(summary.initial_cost, 3.0 * summary.final_cost) << dimension;
  }
}

TEST(ChordalStart, HasNoUseForEdgesOfWeightZero) {
  for (const int dimension : {2, 3}) {
    const PoseGraphWorld right(dimension, 100, 25, 0, 0.02, 3);
    const PoseGraphWorld world(dimension, 100, 25, 15, 0.02, 3);
    std::vector<double> weights(world.truth.edges.size(), 1.0);
    std::fill(weights.end() - 15, weights.end(), 0.0);
    PoseGraph start = world.truth, expected = right.truth;
    ASSERT_TRUE(ChordalStart(world.truth).Compute(weights, &start.poses).ok());
    ASSERT_TRUE(StartByChordalRelaxation(&expected).ok());
    EXPECT_LT(PoseGraphWorld::LargestDistance(start, expected), 1e-7) << dimension;
    PoseGraph bent = world.truth;
    ASSERT_TRUE(StartByChordalRelaxation(&bent).ok());
    EXPECT_GT(PoseGraphWorld::LargestDistance(bent, expected), 0.1) << dimension;
  }
}

TEST(ChordalStart, GivesTheSameFromCallToCall) {
  const PoseGraphWorld world(3, 60, 20, 5, 0.02, 3);
  ChordalStart chordal(world.truth);
  std::vector<double> weights(world.truth.edges.size(), 1.0), first, other, again;
  ASSERT_TRUE(chordal.Compute(weights, &first).ok());
  weights.back() = 0.25;
  ASSERT_TRUE(chordal.Compute(weights, &other).ok());
  weights.back() = 1.0;
  ASSERT_TRUE(chordal.Compute(weights, &again).ok());
  EXPECT_EQ(first, again);
  EXPECT_NE(first, other);
}

TEST(ChordalStart, NamesWhatIsWrong) {
  const PoseGraphWorld world(2, 30, 10, 0, 0.02, 3);
  ChordalStart chordal(world.truth);
  std::vector<double> poses = {1.0};
  const auto refusal = [&](const std::vector<double>& weights) {
    const Status status = chordal.Compute(weights, &poses);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_EQ(poses, std::vector<double>{1.0});
    return status.message;
  };
  EXPECT_NE(refusal({1.0, 1.0}).find("2 weights for"), std::string::npos);
  std::vector<double> weights(world.truth.edges.size(), 1.0);
  weights[3] = -1.0;
  EXPECT_NE(refusal(weights).find("edge 3"), std::string::npos);
  weights[3] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(refusal(weights).find("edge 3"), std::string::npos);
  weights.assign(world.truth.edges.size(), 0.0);
  weights[0] = 1.0;
  EXPECT_NE(refusal(weights).find("no edges lead from vertex 0 to vertex 20"), std::string::npos);
}

TEST(SpanningTree, PlacesEveryVertexFromTheFirst) {
  for (const int dimension : {2, 3}) {
    const PoseGraphWorld world(dimension, 50, 20, 0, 0.0, 1);
    PoseGraph start = world.WithoutPlaces();
    ASSERT_TRUE(StartAlongSpanningTree(&start).ok());
    EXPECT_LT(PoseGraphWorld::LargestDistance(start, world.truth), 1e-9) << dimension;
    EXPECT_LT(LargestTurn(start, world.truth), 1e-9) << dimension;
  }
}

TEST(SpanningTree, NamesAVertexThatNoEdgesLeadTo) {
  PoseGraphWorld world(2, 30, 40, 0, 0.0, 1);
  world.truth.edges.erase(world.truth.edges.begin() + 10);
  const std::vector<double> before = world.truth.poses;
  const Status status = StartAlongSpanningTree(&world.truth);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("vertex 110"), std::string::npos) << status.message;
  EXPECT_EQ(world.truth.poses, before);
}

}  // namespace
}  // namespace inceres
