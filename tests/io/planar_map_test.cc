// Planar maps with landmarks: what a file says, what it may not say, and the graph it becomes.
#include "inceres/io/planar_map.h"

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "support/temp_dir.h"
#include "support/test_data.h"

namespace inceres {
namespace {

using test::TempDir;
using test::WriteBytes;

class PlanarMapTest : public ::testing::Test {
 protected:
  Status ReadText(const std::string& text) {
    WriteBytes(dir_.File("map.txt"), text);
    return ReadPlanarMap(dir_.File("map.txt"), &map_);
  }

  void ExpectError(const std::string& text, int line, const std::string& what) {
    map_ = PlanarMap();
    map_.landmark_ids.resize(77);
    const Status status = ReadText(text);
    EXPECT_EQ(status.code, StatusCode::kIo) << what;
    const std::string expected = dir_.File("map.txt") + ":" + std::to_string(line) + ": " + what;
    EXPECT_EQ(status.message, expected);
    EXPECT_EQ(map_.landmark_ids.size(), 77u);
  }

  TempDir dir_;
  PlanarMap map_;
};

// Two steps of a meter, the first with a turn to the left; landmark 4 is at (1, 3).
const std::string kSteps =
    "ODOMETRY 2 5 1 0 0 0.04 0 0 0.01 0 0.0025\n"
    "ODOMETRY 0 2 1 0 1.5707963267948966 0.04 0.01 0 0.01 0 0.0025\n";
const std::string kSightings =
    "LANDMARK 2 4 3 0 0.25 0.1 0.5\n"
    "BR 5 4 0 2 0.1 0.5\n";

TEST_F(PlanarMapTest, ReadsOdometryAndBothKindsOfSightings) {
  const Status status = ReadText("# a map\n\n" + kSightings + kSteps);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(map_.poses.ids, (std::vector<std::int64_t>{0, 2, 5}));
  EXPECT_EQ(map_.landmark_ids, (std::vector<std::int64_t>{4}));
  ASSERT_EQ(map_.poses.edges.size(), 2u);
  EXPECT_EQ(map_.poses.edges[0].from, 1);
  EXPECT_EQ(map_.poses.edges[0].to, 2);
  EXPECT_NEAR(map_.poses.edges[0].information[0], 25.0, 1e-12);
  EXPECT_NEAR(map_.poses.edges[0].information[8], 400.0, 1e-10);
  // The inverse of [0.04 0.01; 0.01 0.01].
  EXPECT_NEAR(map_.poses.edges[1].information[0], 100.0 / 3.0, 1e-10);
  EXPECT_NEAR(map_.poses.edges[1].information[1], -100.0 / 3.0, 1e-10);
  EXPECT_NEAR(map_.poses.PoseData(2)[0], 1.0, 1e-15);
  EXPECT_NEAR(map_.poses.PoseData(2)[1], 1.0, 1e-15);
  ASSERT_EQ(map_.sightings.size(), 2u);
  EXPECT_EQ(map_.sightings[0].kind, PlanarSighting::kPosition);
  EXPECT_EQ(map_.sightings[0].covariance[1], 0.1);
  EXPECT_EQ(map_.sightings[1].kind, PlanarSighting::kRangeBearing);
  EXPECT_EQ(map_.sightings[1].z[0], 2.0);
  EXPECT_EQ(map_.sightings[1].z[1], 0.0);
  EXPECT_EQ(map_.sightings[1].covariance[0], 0.25);
  EXPECT_EQ(map_.sightings[1].covariance[3], 0.1 * 0.1);
  EXPECT_NEAR(map_.landmarks[0], 1.0, 1e-15);
  EXPECT_NEAR(map_.landmarks[1], 3.0, 1e-15);
}

TEST_F(PlanarMapTest, NamesWhatIsWrong) {
  ExpectError("", 1, "the file has no measurements");
  ExpectError("EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n", 1,
              "EDGE_SE2: tag: not known; known are ODOMETRY, LANDMARK and BR");
  ExpectError("ODOMETRY 0 0 1 0 0 1 0 0 1 0 1\n", 1,
              "ODOMETRY: to: odometry from pose 0 to itself");
  ExpectError("ODOMETRY -1 0 1 0 0 1 0 0 1 0 1\n", 1, "ODOMETRY: from: -1 is negative");
  ExpectError("ODOMETRY 0 1 1 0 0 1 0 0 1 0 0\n", 1, "ODOMETRY: covariance: not positive definite");
  ExpectError(kSteps + "LANDMARK 2 4 3 0 0.25 0.5 0.5\n", 3,
              "LANDMARK: covariance: not positive definite");
  ExpectError(kSteps + "BR 2 4 0 -3 0.1 0.1\n", 3, "BR: range: not positive");
  ExpectError(kSteps + "BR 2 4 0 3 0 0.1\n", 3, "BR: bearing_std: not positive");
  ExpectError(kSteps + "BR 2 4 0 3 0.1 1e-200\n", 3, "BR: range_std: not positive");
  ExpectError(kSteps + "LANDMARK 2 5 3 0 0.25 0 0.5\n", 3, "landmark: 5 is a pose on another line");
  ExpectError(kSteps + "LANDMARK 7 4 3 0 0.25 0 0.5\n", 4,
              "no odometry leads from pose 0 to pose 7");
}

TEST_F(PlanarMapTest, NamesFieldsThatAreMissingOrTooMany) {
  const auto message = [this](const std::string& text) { return ReadText(text).message; };
  EXPECT_NE(message("ODOMETRY 0 1 1 0\n").find(":1: ODOMETRY: motion(2): "), std::string::npos);
  EXPECT_NE(message("ODOMETRY 0 1 1 0 0 1 0 0 1 0\n").find(":1: ODOMETRY: covariance(5): "),
            std::string::npos);
  EXPECT_NE(message("BR 0 1 0.1 x 1 1\n").find(":1: BR: range: "), std::string::npos);
  EXPECT_NE(message("LANDMARK 0 1 1 1 1 0 1 9\n").find(":1: LANDMARK: after the last field"),
            std::string::npos);
  EXPECT_NE(message("LANDMARK 0 1 nan 1 1 0 1\n").find(":1: LANDMARK: position(0): "),
            std::string::npos);
}

TEST_F(PlanarMapTest, BecomesAGraphOfItsMeasurements) {
  ASSERT_TRUE(ReadText(kSteps + kSightings).ok());
  FactorGraph graph;
  PlanarMapGraph ids;
  ASSERT_TRUE(AddPlanarMap(map_, PlanarMapOptions(), &graph, &ids).ok());
  EXPECT_EQ(graph.num_factors(), 4);
  ASSERT_EQ(ids.landmarks.size(), 1u);
  EXPECT_EQ(graph.role(ids.landmarks[0]), Role::kLandmark);
  EXPECT_EQ(ids.sightings[0].family, ids.positions.id);
  EXPECT_EQ(ids.sightings[1].family, ids.bearings.id);
  graph.SetConstant(ids.poses.poses[0], true);
  // 10 σ of the distance of the last sighting off: of 0.5 m.
  double moved[2] = {1.0, 8.0};
  graph.SetValues(ids.landmarks[0], moved);
  SolverOptions options;
  options.max_num_iterations = 0;
  // The first sighting is off by 5 m along x in the pose's axes, of covariance [0.25 0.1; 0.1 0.5].
  const double first = 25.0 * 0.5 / (0.25 * 0.5 - 0.01), second = 100.0;
  EXPECT_NEAR(Solve(options, &graph).initial_cost, 0.5 * (first + second), 1e-9);
  options.max_num_iterations = 50;
  EXPECT_LT(Solve(options, &graph).final_cost, 1e-12);
}

// A place as a distance and an angle has the same covariance to first order: near the minimum the
// cost is the same.
TEST_F(PlanarMapTest, TurnsPlacesIntoRangeAndBearing) {
  ASSERT_TRUE(ReadText(kSteps + "LANDMARK 2 4 3 1 0.0025 0.001 0.005\n").ok());
  double costs[2];
  for (int k = 0; k < 2; ++k) {
    FactorGraph graph;
    PlanarMapGraph ids;
    PlanarMapOptions options;
    options.range_and_bearing = k == 1;
    options.landmark_role = Role::kFrame;
    ASSERT_TRUE(AddPlanarMap(map_, options, &graph, &ids).ok());
    EXPECT_EQ(graph.role(ids.landmarks[0]), Role::kFrame);
    EXPECT_EQ(ids.sightings[0].family, k == 1 ? ids.bearings.id : ids.positions.id);
    const double* at = graph.Values(ids.landmarks[0]);
    const double near[2] = {at[0] + 1e-4, at[1] - 2e-4};
    graph.SetValues(ids.landmarks[0], near);
    SolverOptions solver;
    solver.max_num_iterations = 0;
    costs[k] = Solve(solver, &graph).initial_cost;
  }
  EXPECT_GT(costs[0], 1e-6);
  EXPECT_NEAR(costs[1], costs[0], 1e-3 * costs[0]);
}

TEST_F(PlanarMapTest, RefusesAMapThatDoesNotFitTogether) {
  ASSERT_TRUE(ReadText(kSteps + kSightings).ok());
  FactorGraph graph;
  PlanarMap bad = map_;
  bad.sightings[1].landmark = 9;
  EXPECT_EQ(AddPlanarMap(bad, PlanarMapOptions(), &graph, nullptr).message,
            "sighting 1: the map has no such pose or landmark");
  bad = map_;
  bad.sightings[0].covariance[0] = -1.0;
  EXPECT_EQ(AddPlanarMap(bad, PlanarMapOptions(), &graph, nullptr).message,
            "sighting 0: the covariance is not positive definite");
  bad = map_;
  bad.sightings[0].z[0] = bad.sightings[0].z[1] = 0.0;
  PlanarMapOptions options;
  options.range_and_bearing = true;
  EXPECT_EQ(AddPlanarMap(bad, options, &graph, nullptr).code, StatusCode::kInvalidArgument)
      << "a landmark at the pose is seen in no direction";
  bad = map_;
  bad.landmarks.pop_back();
  EXPECT_EQ(AddPlanarMap(bad, PlanarMapOptions(), &graph, nullptr).message,
            "PlanarMap: landmarks has 1 values instead of 2");
  bad = map_;
  bad.landmark_ids.push_back(9);
  EXPECT_EQ(AddPlanarMap(bad, PlanarMapOptions(), &graph, nullptr).message,
            "PlanarMap: landmarks has 2 values instead of 4");
  bad = map_;
  bad.poses.dimension = 3;
  bad.poses.poses.assign(21, 0.5);
  bad.poses.edges.clear();
  const Status spatial = AddPlanarMap(bad, PlanarMapOptions(), &graph, nullptr);
  EXPECT_EQ(spatial.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(spatial.message, "PlanarMap: poses.dimension is 3, not 2");
  EXPECT_EQ(graph.num_variables(), 0);
}

TEST(VictoriaPark, IsReadBothWaysAndComesTogether) {
  const std::string path = test::FindData("pose_graph/victoria_park.txt");
  if (path.empty()) {
    GTEST_SKIP() << test::MissingData("pose_graph/victoria_park.txt");
  }
  for (const bool range_and_bearing : {false, true}) {
    FactorGraph graph;
    PlanarMapGraph ids;
    PlanarMapOptions options;
    options.range_and_bearing = range_and_bearing;
    options.sighting_loss = std::make_shared<HuberLoss>(1.0);
    const Status status = ReadPlanarMap(path, &graph, &ids, options);
    ASSERT_TRUE(status.ok()) << status.message;
    EXPECT_EQ(ids.poses.poses.size(), 6969u);
    EXPECT_EQ(ids.landmarks.size(), 151u);
    EXPECT_EQ(ids.sightings.size(), 3640u);
    graph.SetConstant(ids.poses.poses[0], true);
    SolverOptions solver;
    solver.strategy = TrustRegionStrategyKind::kDogleg;
    solver.max_num_iterations = 40;
    const Summary summary = Solve(solver, &graph);
    EXPECT_TRUE(summary.IsSolutionUsable()) << summary.message;
    EXPECT_LT(summary.final_cost, 0.2 * summary.initial_cost);
  }
}

}  // namespace
}  // namespace inceres
