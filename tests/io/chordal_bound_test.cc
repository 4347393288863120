// The lower bound of the chordal cost: met without noise and with moderate noise, and never above
// what another choice of poses costs.
#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "inceres/io/g2o.h"
#include "inceres/io/pose_graph_start.h"
#include "support/pose_graph_world.h"

namespace inceres {
namespace {

using test::PoseGraphWorld;

class ChordalBoundTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!HasChordalBound()) {
      ChordalBound bound;
      const Status status = BoundChordalCost(PoseGraphWorld(2, 9, 3, 0, 0.0, 1).truth, &bound);
      EXPECT_EQ(status.code, StatusCode::kUnavailable);
      EXPECT_NE(status.message.find("Spectra"), std::string::npos);
      GTEST_SKIP() << "without Spectra";
    }
  }
};

TEST_F(ChordalBoundTest, IsTightWithModerateNoise) {
  for (const int dimension : {2, 3}) {
    PoseGraph graph = PoseGraphWorld(dimension, 120, 30, 0, 0.02, 5).truth;
    ASSERT_TRUE(StartByChordalRelaxation(&graph).ok());
    ChordalBound bound;
    const Status status = BoundChordalCost(graph, &bound);
    ASSERT_TRUE(status.ok()) << status.message;
    EXPECT_GT(bound.cost, 1.0);
    EXPECT_LE(bound.lower_bound, bound.cost);
    EXPECT_LT(bound.gap, 1e-4) << dimension;
    EXPECT_GT(bound.smallest_eigenvalue, -1e-3) << dimension;
    EXPECT_LT(bound.largest_angle, 0.2);
  }
}

// Half of what the information says, as chords are nearly angles: 2 f is about χ².
TEST_F(ChordalBoundTest, CostIsThatOfTheEdges) {
  PoseGraph graph = PoseGraphWorld(3, 120, 30, 0, 0.02, 5).truth;
  ChordalBound bound;
  ASSERT_TRUE(BoundChordalCost(graph, &bound).ok());
  const double degrees = 6.0 * static_cast<double>(graph.edges.size() - 119);
  EXPECT_NEAR(bound.cost, degrees, 5.0 * std::sqrt(2.0 * degrees));
}

// From a poor start the solve ends in a local minimum, and the bound says so: it stays below the
// global one.
TEST_F(ChordalBoundTest, IsNotTightAtALocalMinimum) {
  PoseGraph graph;
  graph.dimension = 2;
  const int count = 20;
  for (int i = 0; i < count; ++i) {
    graph.ids.push_back(i);
    const double angle = 2.0 * M_PI * i / count;  // all the way round, where nothing turns
    graph.poses.insert(graph.poses.end(), {std::cos(angle), std::sin(angle), angle});
    PoseGraphEdge edge;
    edge.from = i;
    edge.to = (i + 1) % count;
    edge.information = {1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 100.0};
    graph.edges.push_back(edge);
  }
  ChordalBound bound;
  ASSERT_TRUE(BoundChordalCost(graph, &bound).ok());
  EXPECT_GT(bound.cost, 1.0);
  EXPECT_LT(bound.smallest_eigenvalue, -0.1);
  EXPECT_NEAR(bound.lower_bound, 0.0, 1e-6);
  EXPECT_GT(bound.gap, 0.9);
  for (int i = 0; i < count; ++i) {
    graph.PoseData(i)[0] = graph.PoseData(i)[1] = graph.PoseData(i)[2] = 0.0;
  }
  ASSERT_TRUE(BoundChordalCost(graph, &bound).ok());
  EXPECT_NEAR(bound.cost, 0.0, 1e-9);
}

TEST_F(ChordalBoundTest, NamesWhatIsWrong) {
  PoseGraph graph = PoseGraphWorld(2, 20, 5, 0, 0.02, 5).truth;
  graph.edges[3].information[0] = -1.0;
  ChordalBound bound;
  bound.cost = 7.0;
  const Status indefinite = BoundChordalCost(graph, &bound);
  EXPECT_EQ(indefinite.code, StatusCode::kInvalidArgument);
  EXPECT_NE(indefinite.message.find("edge 3, from vertex 30 to 40"), std::string::npos);
  PoseGraph apart = PoseGraphWorld(2, 20, 30, 0, 0.02, 5).truth;
  apart.edges.erase(apart.edges.begin() + 4);
  const Status cut = BoundChordalCost(apart, &bound);
  EXPECT_NE(cut.message.find("vertex 50"), std::string::npos) << cut.message;
  EXPECT_EQ(bound.cost, 7.0);
}

TEST_F(ChordalBoundTest, OfAVertexAloneThereIsNone) {
  const PoseGraph alone = PoseGraphWorld(2, 1, 5, 0, 0.02, 5).truth;
  ChordalBound bound;
  EXPECT_EQ(BoundChordalCost(alone, &bound).code, StatusCode::kSingular);
}

TEST_F(ChordalBoundTest, RefusesAGraphThatDoesNotFitTogether) {
  const PoseGraph good = PoseGraphWorld(2, 20, 5, 0, 0.02, 5).truth;
  PoseGraph bad = good;
  bad.poses.clear();
  ChordalBound bound;
  bound.cost = 7.0;
  EXPECT_EQ(BoundChordalCost(bad, &bound).message, "PoseGraph: poses has 0 values instead of 60");
  bad = good;
  bad.edges[3].to = 20;
  const Status status = BoundChordalCost(bad, &bound);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message, "PoseGraph: edges[3] has an end that is no vertex");
  EXPECT_EQ(bound.cost, 7.0);
}

}  // namespace
}  // namespace inceres
