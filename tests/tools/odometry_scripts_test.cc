// The protocols of the replays of stereo odometries and pose graphs, counted on small problems and
// on the public ones.
#include <algorithm>
#include <cctype>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/rotation.h"
#include "inceres/solver/solver.h"
#include "support/test_data.h"
#include "tools/problems/pose_graph_ceres_problem.h"
#include "tools/replay/replay_ceres_problem.h"
#include "tools/replay/replay_graph.h"
#include "tools/replay/replay_scripts.h"
#include "tools/small_replays.h"

namespace inceres::tools {
namespace {

using Kind = ReplayVariable::Kind;
using Planar = PlanarRelativePoseFamily::Measurement;
using Spatial = RelativePoseFamily::Measurement;

template <typename Measurement>
int CountFactors(const ReplayStep& step) {
  return static_cast<int>(
      std::count_if(step.factors.begin(), step.factors.end(), [](const ReplayFactor& factor) {
        return std::holds_alternative<Measurement>(factor.measurement);
      }));
}

// The cost of the whole script at its start values; poses and points follow from the values before
// them.
double CostAtStart(const ReplayScript& script) {
  ReplayCeresProblem living(false);
  for (const ReplayStep& step : script.steps) {
    EXPECT_TRUE(living.Add(step).ok());
  }
  double cost = -1.0;
  EXPECT_TRUE(living.problem()->Evaluate({}, &cost, nullptr, nullptr, nullptr));
  return cost;
}

TEST(StereoReplay, PointsEnterWithTheirSecondPoseAndAllTheirSightings) {
  const StereoOdometry odometry = SmallStereo(16);
  const ReplayScript script = MakeStereoReplay(odometry);
  EXPECT_FALSE(script.dogleg);
  EXPECT_TRUE(HasLandmarks(script));
  ASSERT_EQ(script.steps.size(), 15u);
  EXPECT_TRUE(script.steps[0].variables[0].constant) << "the camera on the body";
  EXPECT_TRUE(script.steps[0].variables[1].constant) << "the first pose";
  std::map<int, int> sightings;  // of each point so far
  std::vector<Kind> kinds;
  std::size_t next = 0;
  for (std::size_t i = 0; i < script.steps.size(); ++i) {
    const ReplayStep& step = script.steps[i];
    int fresh = 0, due = 0;
    for (; next < odometry.sightings.size() &&
           odometry.sightings[next].pose <= static_cast<int>(i) + 1;
         ++next) {
      const int count = ++sightings[odometry.sightings[next].point];
      fresh += count == 2 ? 1 : 0;
      due += count == 2 ? 2 : count > 2 ? 1 : 0;
    }
    EXPECT_EQ(static_cast<int>(step.variables.size()), fresh + (i == 0 ? 3 : 1)) << i;
    EXPECT_EQ(CountFactors<StereoPointSighting>(step), due) << i;
    EXPECT_EQ(static_cast<int>(step.factors.size()), due) << i;
    EXPECT_EQ(step.closes_loop, i == 13) << "pose 14 sees pose 0's points again";
    for (const ReplayVariable& variable : step.variables) {
      kinds.push_back(variable.kind);
    }
    for (const ReplayFactor& factor : step.factors) {
      EXPECT_EQ(ToString(factor.loss), "huber:1");
      ASSERT_LT(*std::max_element(factor.variables.begin(), factor.variables.end()),
                static_cast<int>(kinds.size()));
      EXPECT_EQ(factor.variables[1], 0);
      EXPECT_EQ(kinds[static_cast<std::size_t>(factor.variables[2])], Kind::kPoint);
    }
  }
  EXPECT_GT(sightings.size(), 70u);
}

// With the odometry and the triangulations as they should be nothing is left but what the second
// and third sightings differ by.
TEST(StereoReplay, StartsWherePosesAndTriangulationsPutIt) {
  StereoOdometry exact = SmallStereo(10);
  for (StereoSighting& sighting :
       exact.sightings) {  // as if every pose saw what the first to see it triangulated
    const auto first =
        std::find_if(exact.sightings.begin(), exact.sightings.end(),
                     [&](const StereoSighting& other) { return other.point == sighting.point; });
    double world[3], back[7], X[3];
    TransformPoint(exact.poses[static_cast<std::size_t>(first->pose)].data(), first->in_camera,
                   world);
    InvertPose(exact.poses[static_cast<std::size_t>(sighting.pose)].data(), back);
    TransformPoint(back, world, X);
    sighting.left[0] = 500.0 * X[0] / X[2] + 320.0;
    sighting.left[1] = 510.0 * X[1] / X[2] + 240.0;
    sighting.right_u = sighting.left[0] - 200.0 / X[2];
  }
  EXPECT_LT(CostAtStart(MakeStereoReplay(exact)), 1e-18);
  exact.poses[5][0] += 0.1;
  EXPECT_GT(CostAtStart(MakeStereoReplay(exact)), 10.0);
}

class PoseGraphReplay : public testing::TestWithParam<int> {};

INSTANTIATE_TEST_SUITE_P(Dimensions, PoseGraphReplay, testing::Values(2, 3));

TEST_P(PoseGraphReplay, APoseArrivesWithItsEdgesToEarlierOnes) {
  const PoseGraph graph = NoisyPoseGraph(GetParam(), 26);
  ReplayScript script;
  ASSERT_TRUE(MakePoseGraphReplay(graph, &script).ok());
  EXPECT_FALSE(HasLandmarks(script));
  ASSERT_EQ(script.steps.size(), 25u);
  for (int i = 0; i < 25; ++i) {
    const ReplayStep& step = script.steps[static_cast<std::size_t>(i)];
    const int pose = i + 1;  // in the order of ids, which is not that of the file
    EXPECT_EQ(step.variables.size(), i == 0 ? 2u : 1u);
    const ReplayVariable& variable = step.variables.back();
    EXPECT_EQ(variable.kind, GetParam() == 2 ? Kind::kPlanarPose : Kind::kPose);
    EXPECT_EQ(variable.start_from, pose - 1) << "along the odometry, not from a loop";
    EXPECT_FALSE(variable.constant);
    const int edges = 1 + (pose > 1 ? 1 : 0) + (pose % 5 == 0 ? 1 : 0);
    EXPECT_EQ(GetParam() == 2 ? CountFactors<Planar>(step) : CountFactors<Spatial>(step), edges);
    EXPECT_EQ(static_cast<int>(step.factors.size()), edges);
    EXPECT_EQ(step.closes_loop, pose % 5 == 0 && pose > 10);
    for (const ReplayFactor& factor : step.factors) {
      EXPECT_EQ(ToString(factor.loss), "none");
      EXPECT_EQ(std::max(factor.variables[0], factor.variables[1]), pose);
    }
  }
  EXPECT_TRUE(script.steps[0].variables[0].constant);
  EXPECT_TRUE(std::equal(graph.PoseData(25), graph.PoseData(25) + graph.PoseSize(),
                         script.steps[0].variables[0].start.begin()));
}

// The same cost as the graph has as a ceres::Problem, but for the third order of the rotations'
// errors.
TEST_P(PoseGraphReplay, HasTheCostOfTheGraph) {
  PoseGraph graph = NoisyPoseGraph(GetParam(), 26);
  ReplayScript script;
  ASSERT_TRUE(MakePoseGraphReplay(graph, &script).ok());
  ReplayCeresProblem living(false);
  for (const ReplayStep& step : script.steps) {
    ASSERT_TRUE(living.Add(step).ok());
  }
  std::vector<double> state;
  for (int i = 25; i >= 0; --i) {  // the file's values, in the order of the ids
    state.insert(state.end(), graph.PoseData(i), graph.PoseData(i) + graph.PoseSize());
  }
  living.SetState(state);
  double cost = 0.0, expected = 0.0;
  ASSERT_TRUE(living.problem()->Evaluate({}, &cost, nullptr, nullptr, nullptr));
  std::unique_ptr<ceres::Problem> problem;
  ASSERT_TRUE(BuildPoseGraphCeresProblem(graph, {}, graph.poses.data(), &problem).ok());
  ASSERT_TRUE(problem->Evaluate({}, &expected, nullptr, nullptr, nullptr));
  EXPECT_GT(expected, 0.1);
  EXPECT_NEAR(cost, expected, (GetParam() == 2 ? 1e-12 : 1e-4) * expected);
}

// What a pose begins at follows from where the one before is by then, not from where it began.
TEST_P(PoseGraphReplay, APoseBeginsAtThePresentEstimate) {
  const PoseGraph graph = NoisyPoseGraph(GetParam(), 5);
  ReplayScript script;
  ASSERT_TRUE(MakePoseGraphReplay(graph, &script).ok());
  const auto size = static_cast<std::size_t>(graph.PoseSize());
  ReplayCeresProblem living(false);
  FactorGraph factor_graph;
  ReplayGraph growing(false);
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(living.Add(script.steps[static_cast<std::size_t>(i)]).ok());
    ASSERT_TRUE(growing.Add(script.steps[static_cast<std::size_t>(i)], &factor_graph).ok());
  }
  std::vector<double> moved = living.State();
  moved[3 * size] += 7.0;  // of pose 3, the last one
  living.SetState(moved);
  factor_graph.mutable_state() = moved;
  ASSERT_TRUE(living.Add(script.steps[3]).ok());
  ASSERT_TRUE(growing.Add(script.steps[3], &factor_graph).ok());
  std::array<double, 7> expected{};
  (GetParam() == 2 ? ComposePlanarPoses : ComposePoses)(
      moved.data() + 3 * size, script.steps[3].variables[0].start.data(), expected.data());
  const std::vector<double> state = living.State();
  EXPECT_TRUE(std::equal(expected.begin(), expected.begin() + graph.PoseSize(),
                         state.begin() + 4 * graph.PoseSize()));
  EXPECT_EQ(factor_graph.state(), state);
}

TEST_P(PoseGraphReplay, WhatTheFileFixesStaysWhereItStands) {
  PoseGraph graph = NoisyPoseGraph(GetParam(), 6);
  graph.fixed = {1, 3};  // poses 4 and 2 in the order of the ids
  ReplayScript script;
  ASSERT_TRUE(MakePoseGraphReplay(graph, &script).ok());
  EXPECT_FALSE(script.steps[0].variables[0].constant);
  const ReplayVariable& fixed = script.steps[1].variables[0];
  EXPECT_TRUE(fixed.constant);
  EXPECT_LT(fixed.start_from, 0);
  EXPECT_TRUE(
      std::equal(graph.PoseData(3), graph.PoseData(3) + graph.PoseSize(), fixed.start.begin()));
}

TEST_P(PoseGraphReplay, ErrorsNameTheCulprit) {
  PoseGraph graph = NoisyPoseGraph(GetParam(), 6);
  ReplayScript script;
  script.description = "as it was";
  PoseGraph flat = graph;
  flat.edges[1].information[0] = -1.0;  // from pose 2 to pose 0, which points backwards
  Status status = MakePoseGraphReplay(flat, &script);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find(": the information matrix is not positive definite"),
            std::string::npos)
      << status.message;
  EXPECT_EQ(status.message.substr(0, 7), "edge 1,") << status.message;
  PoseGraph loose = graph;
  const auto ends_later = [](const PoseGraphEdge& edge) {
    return std::min(edge.from, edge.to) == 2;
  };  // pose 3, id 10
  loose.edges.erase(std::remove_if(loose.edges.begin(), loose.edges.end(), ends_later),
                    loose.edges.end());
  status = MakePoseGraphReplay(loose, &script);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(status.message,
            "vertex 10 has no edge to one of a lower id: it has no place when it arrives");
  EXPECT_EQ(script.description, "as it was");
}

// Each of the first steps can be solved from where the one before ended.
void ExpectPlayable(const ReplayScript& script, std::size_t num_steps) {
  ASSERT_GE(script.steps.size(), num_steps);
  FactorGraph graph;
  ReplayGraph growing(false);
  for (std::size_t i = 0; i < num_steps; ++i) {
    ASSERT_TRUE(growing.Add(script.steps[i], &graph).ok());
    const Summary summary = Solve({}, &graph);
    ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
    ASSERT_LE(summary.final_cost, summary.initial_cost);
  }
}

class PublicReplay : public testing::TestWithParam<const char*> {};

TEST_P(PublicReplay, PoseGraphsCanBePlayed) {
  const std::string path = test::FindData(GetParam());
  if (path.empty()) {
    GTEST_SKIP() << test::MissingData(GetParam());
  }
  PoseGraph graph;
  ReplayScript script;
  ASSERT_TRUE(ReadG2o(path, &graph).ok());
  const Status status = MakePoseGraphReplay(graph, &script);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(static_cast<int>(script.steps.size()), graph.NumVertices() - 1);
  ExpectPlayable(script, 60);
}

INSTANTIATE_TEST_SUITE_P(Graphs, PublicReplay,
                         testing::Values("pose_graph/M3500.g2o", "pose_graph/intel.g2o",
                                         "pose_graph/sphere.g2o", "pose_graph/parking-garage.g2o",
                                         "pose_graph/city10000.g2o", "pose_graph/kitti_05.g2o"),
                         [](const auto& instance) {
                           std::string name = instance.param;
                           std::replace_if(
                               name.begin(), name.end(),
                               [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
                           return name;
                         });

TEST(PublicStereoReplay, AStereoOdometryCanBePlayed) {
  const std::string folder = test::FindData("stereo");
  if (folder.empty()) {
    GTEST_SKIP() << test::MissingData("stereo");
  }
  StereoOdometry odometry;
  ASSERT_TRUE(ReadStereoOdometry(folder, &odometry).ok());
  const ReplayScript script = MakeStereoReplay(odometry);
  EXPECT_EQ(script.steps.size(), 76u);
  ExpectPlayable(script, 5);
}

}  // namespace
}  // namespace inceres::tools
