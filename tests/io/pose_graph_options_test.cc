// Pose graphs in the error conventions of other programs, and information matrices that are not
// positive definite.
#include <cmath>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "inceres/factors/pose_prior.h"
#include "inceres/io/g2o_graph.h"
#include "inceres/solver/solver.h"
#include "support/pose_graph_world.h"

namespace inceres {
namespace {

using test::PoseGraphWorld;

double CostOf(const PoseGraph& poses, const PoseGraphOptions& options) {
  FactorGraph graph;
  EXPECT_TRUE(AddPoseGraph(poses, options, &graph, nullptr).ok());
  SolverOptions evaluate;
  evaluate.max_num_iterations = 0;
  return Solve(evaluate, &graph).initial_cost;
}

// The vertices moved, so that errors are large.
PoseGraph Moved(PoseGraph graph) {
  for (int i = 1; i < graph.NumVertices(); ++i) {
    graph.PoseData(i)[0] += 0.1 * std::sin(i);
    if (graph.dimension == 2) {
      graph.PoseData(i)[2] += 0.2 * std::cos(i);
    } else {
      const double phi[3] = {0.1 * std::sin(i), 0.2 * std::cos(i), -0.1};
      double turn[4], q[4];
      ExpQuaternion(phi, turn);
      MultiplyQuaternions(graph.PoseData(i) + 3, turn, q);
      std::copy_n(q, 4, graph.PoseData(i) + 3);
    }
  }
  return graph;
}

TEST(PoseGraphOptions, PlanarG2oErrorIsInTheMeasuredAxes) {
  PoseGraph graph = Moved(PoseGraphWorld(2, 30, 10, 0, 0.1, 8).truth);
  for (PoseGraphEdge& edge : graph.edges) {
    edge.information = {4.0, 1.0, 0.5, 1.0, 9.0, -0.25, 0.5, -0.25, 16.0};
  }
  double expected = 0.0;
  for (const PoseGraphEdge& edge : graph.edges) {
    // g2o's EdgeSE2: the motion from the measured pose to the present one.
    double inverse[3], motion[3], back[3], e[3];
    InvertPlanarPose(graph.PoseData(edge.from), inverse);
    ComposePlanarPoses(inverse, graph.PoseData(edge.to), motion);
    InvertPlanarPose(edge.measurement.data(), back);
    ComposePlanarPoses(back, motion, e);
    e[2] = std::remainder(e[2], 2.0 * M_PI);
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t c = 0; c < 3; ++c) {
        expected += 0.5 * e[r] * edge.information[3 * r + c] * e[c];
      }
    }
  }
  PoseGraphOptions options;
  options.convention = PoseErrorConvention::kG2o;
  EXPECT_NEAR(CostOf(graph, options), expected, 1e-11 * expected);
  const double in_g2o = CostOf(graph, options);
  options.convention = PoseErrorConvention::kGtsam;
  EXPECT_EQ(CostOf(graph, options), in_g2o);
  options.convention = PoseErrorConvention::kGeodesic;
  EXPECT_GT(std::fabs(CostOf(graph, options) - in_g2o), 1e-3 * in_g2o);
}

TEST(PoseGraphOptions, SpatialConventionsDifferAsTheyShould) {
  PoseGraph graph = Moved(PoseGraphWorld(3, 30, 10, 0, 0.01, 8).truth);
  PoseGraphOptions options;
  const double geodesic = CostOf(graph, options);
  FactorGraph plain;
  ASSERT_TRUE(AddPoseGraph(graph, nullptr, &plain, nullptr).ok());
  SolverOptions evaluate;
  evaluate.max_num_iterations = 0;
  EXPECT_EQ(Solve(evaluate, &plain).initial_cost, geodesic);
  options.convention = PoseErrorConvention::kCeres;
  const double ceres = CostOf(graph, options);
  EXPECT_LT(ceres, geodesic);  // 2 sin(θ/2) < θ
  EXPECT_GT(ceres, 0.95 * geodesic);
  // g2o's rotations are half as long: four times the information makes up for it.
  options.convention = PoseErrorConvention::kG2o;
  EXPECT_LT(CostOf(graph, options), 0.95 * geodesic);
  PoseGraph heavier = graph;
  for (PoseGraphEdge& edge : heavier.edges) {
    for (const std::size_t k : {21u, 28u, 35u}) {
      edge.information[k] *= 4.0;
    }
  }
  EXPECT_NEAR(CostOf(heavier, options), ceres, 1e-9 * ceres);
}

TEST(PoseGraphOptions, EachConventionHasItsFamilyAndIsSolved) {
  const PoseGraphWorld world(3, 60, 15, 0, 0.01, 4);
  for (const PoseErrorConvention convention :
       {PoseErrorConvention::kGeodesic, PoseErrorConvention::kCeres, PoseErrorConvention::kG2o,
        PoseErrorConvention::kGtsam}) {
    SCOPED_TRACE(ToString(convention));
    PoseGraphOptions options;
    options.convention = convention;
    FactorGraph graph;
    G2oGraph ids;
    ASSERT_TRUE(AddPoseGraph(Moved(world.truth), options, &graph, &ids).ok());
    EXPECT_EQ(ids.edges.id >= 0, convention != PoseErrorConvention::kGeodesic);
    EXPECT_EQ(ids.EdgeFactor(7).index, 7);
    EXPECT_GE(ids.EdgeFactor(7).family, 0);
    graph.SetConstant(ids.poses[0], true);
    ASSERT_TRUE(Solve(SolverOptions(), &graph).IsSolutionUsable());
    PoseGraph solved = world.truth;
    for (int i = 0; i < solved.NumVertices(); ++i) {
      std::copy_n(graph.Values(ids.poses[static_cast<std::size_t>(i)]), 7, solved.PoseData(i));
    }
    EXPECT_LT(PoseGraphWorld::LargestDistance(solved, world.truth), 0.3);
  }
}

TEST(PoseGraphOptions, RefusesInformationThatIsNotDefiniteOrProjectsIt) {
  PoseGraph graph = PoseGraphWorld(2, 12, 5, 0, 0.1, 1).truth;
  graph.edges[4].information = {1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  FactorGraph factors;
  PoseGraphOptions options;
  const Status refused = AddPoseGraph(graph, options, &factors, nullptr);
  EXPECT_EQ(refused.code, StatusCode::kInvalidArgument);
  EXPECT_NE(refused.message.find("edge 4, from vertex 40 to 50"), std::string::npos)
      << refused.message;
  EXPECT_EQ(factors.num_variables(), 0);
  options.indefinite = IndefiniteInformation::kProject;
  ASSERT_TRUE(AddPoseGraph(graph, options, &factors, nullptr).ok());
  EXPECT_EQ(factors.num_variables(), 12);
  graph.edges[4].information.fill(0.0);
  EXPECT_FALSE(AddPoseGraph(graph, options, &factors, nullptr).ok());  // of nothing comes nothing
}

TEST(PoseGraphOptions, RefusesAGraphThatDoesNotFitTogether) {
  PoseGraph graph = PoseGraphWorld(2, 12, 5, 0, 0.1, 1).truth;
  graph.edges[3].to = 12;
  FactorGraph factors;
  const Status refused = AddPoseGraph(graph, PoseGraphOptions(), &factors, nullptr);
  EXPECT_EQ(refused.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(refused.message, "PoseGraph: edges[3] has an end that is no vertex");
  EXPECT_EQ(factors.num_variables() + factors.num_families(), 0);
}

TEST(ProjectInformation, RaisesWhatIsNegativeAndLeavesTheRest) {
  // Eigenvalues 3, −1 and 1, the first two along (1, ±1, 0).
  double information[9] = {1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  EXPECT_TRUE(ProjectInformation(information, 3));
  const double expected[9] = {1.5, 1.5, 0.0, 1.5, 1.5, 0.0, 0.0, 0.0, 1.0};
  for (int k = 0; k < 9; ++k) {
    EXPECT_NEAR(information[k], expected[k], 1e-8) << k;
  }
  double U[9];
  EXPECT_TRUE(SqrtInformation(information, 3, U));
  double good[9] = {2.0, 1.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 5.0};
  EXPECT_FALSE(ProjectInformation(good, 3));
  EXPECT_EQ(good[1], 1.0);
  double infinite[9] = {std::numeric_limits<double>::infinity(), 0, 0, 0, 1, 0, 0, 0, 1};
  EXPECT_FALSE(ProjectInformation(infinite, 3));
}

}  // namespace
}  // namespace inceres
