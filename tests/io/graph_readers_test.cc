// Files as graphs: BAL, g2o and keyframes become variables and factors of the core, or nothing.
#include <climits>
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>

#include <gtest/gtest.h>

#include "inceres/io/bal_graph.h"
#include "inceres/io/g2o_graph.h"
#include "inceres/io/keyframe_graph.h"
#include "inceres/solver/solver.h"
#include "io/capped_count.h"
#include "support/temp_dir.h"

namespace inceres {
namespace {

class GraphReaders : public testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& text) {
    test::WriteBytes(dir_.File(name), text);
    return dir_.File(name);
  }
  // What a graph that was there before keeps.
  void AddOneVariable() {
    const double x = 5.0;
    ASSERT_EQ(graph_.AddVariable(&x, 1, Role::kFrame), 0);
  }

  test::TempDir dir_;
  FactorGraph graph_;
};

using BalGraphTest = GraphReaders;
using G2oGraphTest = GraphReaders;
using KeyframeGraphTest = GraphReaders;

// The values of 800 million points: more than an int counts is not less than nothing.
TEST(CappedCount, IsTheCountUpToTheLargestInt) {
  EXPECT_EQ(internal::CappedCount(0), 0);
  EXPECT_EQ(internal::CappedCount(12345), 12345);
  EXPECT_EQ(internal::CappedCount(INT_MAX), INT_MAX);
  EXPECT_EQ(internal::CappedCount(std::size_t{3} * 800'000'000), INT_MAX);
}

TEST_F(BalGraphTest, HasTheCostOfTheFile) {
  BalProblem bal;
  ASSERT_TRUE(
      ReadBal(std::string(INCERES_SOURCE_DIR) + "/bal_data/street-16-1200-pre.txt", &bal).ok());
  AddOneVariable();
  BalGraph ids;
  const Status status =
      ReadBal(std::string(INCERES_SOURCE_DIR) + "/bal_data/street-16-1200-pre.txt", &graph_, &ids);
  ASSERT_TRUE(status.ok()) << status.message;
  ASSERT_EQ(ids.cameras.size(), static_cast<std::size_t>(bal.num_cameras));
  ASSERT_EQ(ids.points.size(), static_cast<std::size_t>(bal.num_points));
  EXPECT_EQ(ids.cameras[0], 1);
  EXPECT_EQ(graph_.role(ids.cameras[3]), Role::kFrame);
  EXPECT_EQ(graph_.role(ids.points[3]), Role::kLandmark);
  EXPECT_EQ(graph_.Values(ids.points[3])[2], bal.PointData(3)[2]);
  SolverOptions options;
  options.max_num_iterations = 0;
  const double rms = ReprojectionRms(bal);
  const double cost = 0.5 * static_cast<double>(bal.observations.size()) * rms * rms;
  EXPECT_NEAR(Solve(options, &graph_).initial_cost, cost, 1e-9 * cost);
  EXPECT_TRUE(graph_.Validate().ok());
}

TEST_F(BalGraphTest, HoldsWhatNothingObserves) {
  BalProblem bal;
  bal.num_cameras = 2;
  bal.num_points = 2;
  bal.cameras = {0, 0, 0, 0, 0, -5, 500, 0, 0, 0, 0, 0, 1, 0, -5, 500, 0, 0};
  bal.points.assign(6, 0.5);
  bal.observations = {{0, 1, 1.0, 2.0}};
  const auto loss = std::make_shared<HuberLoss>(1.0);
  const BalGraph ids = AddBal(bal, loss, &graph_);
  EXPECT_FALSE(graph_.IsConstant(ids.cameras[0]));
  EXPECT_TRUE(graph_.IsConstant(ids.cameras[1]));
  EXPECT_TRUE(graph_.IsConstant(ids.points[0]));
  EXPECT_FALSE(graph_.IsConstant(ids.points[1]));
  EXPECT_EQ(graph_.loss(ids.reprojections, 0), loss.get());
}

TEST_F(BalGraphTest, LeavesTheGraphAloneOnAnError) {
  BalGraph ids;
  ids.cameras = {77};
  EXPECT_EQ(ReadBal(dir_.File("missing"), &graph_, &ids).code, StatusCode::kIo);
  const Status status = ReadBal(Write("bad", "1 1 1\n0 0 1 1\nnan"), &graph_, &ids);
  EXPECT_EQ(status.code, StatusCode::kIo);
  EXPECT_NE(status.message.find("bad:3"), std::string::npos) << status.message;
  EXPECT_EQ(graph_.num_variables() + graph_.num_families(), 0);
  EXPECT_EQ(ids.cameras.size(), 1u);
}

TEST_F(G2oGraphTest, PlanarPosesSettleWhereTheEdgesPutThem) {
  AddOneVariable();
  G2oGraph ids;
  const Status status = ReadG2o(Write("a.g2o",
                                      "VERTEX_SE2 7 0 0 0\nVERTEX_SE2 3 9 9 0\nFIX 7\n"
                                      "EDGE_SE2 7 3 1 2 0.5 4 0 0 4 0 9\n"),
                                &graph_, &ids);
  ASSERT_TRUE(status.ok()) << status.message;
  ASSERT_EQ(ids.poses.size(), 2u);
  EXPECT_TRUE(graph_.IsConstant(ids.poses[0]));
  EXPECT_EQ(ids.spatial.family, nullptr);
  EXPECT_EQ(ids.planar->size(), 1);
  EXPECT_LT(Solve(SolverOptions(), &graph_).final_cost, 1e-15);
  EXPECT_NEAR(graph_.Values(ids.poses[1])[0], 1.0, 1e-7);
  EXPECT_NEAR(graph_.Values(ids.poses[1])[1], 2.0, 1e-7);
  EXPECT_NEAR(graph_.Values(ids.poses[1])[2], 0.5, 1e-7);
}

TEST_F(G2oGraphTest, SpatialPosesSettleWhereTheEdgesPutThem) {
  G2oGraph ids;
  std::string information;
  for (int r = 0; r < 6; ++r) {
    for (int c = r; c < 6; ++c) {
      information += r == c ? " 4" : " 0.1";
    }
  }
  const Status status =
      ReadG2o(Write("a.g2o",
                    "VERTEX_SE3:QUAT 0 1 0 0 0 0 0.70710678118654752 0.70710678118654752\n"
                    "VERTEX_SE3:QUAT 1 5 5 5 0 0 0 1\nFIX 0\n"
                    "EDGE_SE3:QUAT 0 1 1 0 2 0.70710678118654752 0 0 0.70710678118654752" +
                        information + "\n"),
              &graph_, &ids);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_LT(Solve(SolverOptions(), &graph_).final_cost, 1e-12);
  const double* pose = graph_.Values(ids.poses[1]);
  // A quarter turn about z, then one step along its own x and two up.
  EXPECT_NEAR(pose[0], 1.0, 1e-5);
  EXPECT_NEAR(pose[1], 1.0, 1e-5);
  EXPECT_NEAR(pose[2], 2.0, 1e-5);
  for (int k = 3; k < 7; ++k) {
    EXPECT_NEAR(std::fabs(pose[k]), 0.5, 1e-5);
  }
}

TEST_F(G2oGraphTest, NamesAnEdgeWithoutInformationAndLeavesTheGraphAlone) {
  const Status status = ReadG2o(Write("a.g2o",
                                      "VERTEX_SE2 7 0 0 0\nVERTEX_SE2 3 9 9 0\n"
                                      "EDGE_SE2 7 3 1 2 0.5 4 0 0 0 0 9\n"),
                                &graph_);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("edge 0, from vertex 7 to 3"), std::string::npos) << status.message;
  EXPECT_EQ(graph_.num_variables() + graph_.num_families(), 0);
  EXPECT_EQ(ReadG2o(dir_.File("missing"), &graph_).code, StatusCode::kIo);
}

std::string Diagonal(int size) {
  std::string text;
  for (int k = 0; k < size * size; ++k) {
    text += k % (size + 1) == 0 ? " 4" : " 0";
  }
  return text;
}

// Two keyframes a meter apart, a feature at 2 m that both see, one that only the first sees.
std::string TwoKeyframes() {
  const std::string identity = " 1 0 0 0 1 0 0 0 1 ";
  return "KEYFRAME 0" + identity + "0 0 0\nFEATURE 0 3 0.1 0.2 0.5\nFEATURE 0 4 0.3 0.2 0\n" +
         "KEYFRAME 1" + identity + "1 0 0\nDEPTH_GUESS 0 3 0.4\nOBS 1 0 3 -0.4 0.2 0 4 0 4\n" +
         "BETWEEN 0 1" + identity + "-1 0 0" + Diagonal(6) + "\n";
}

TEST_F(KeyframeGraphTest, HasWhatTheFileHas) {
  KeyframeGraph ids;
  KeyframeGraphOptions options;
  options.read.loss = std::make_shared<HuberLoss>(1.0);
  const Status status = ReadKeyframes(Write("a.kf", TwoKeyframes()), &graph_, &ids, options);
  ASSERT_TRUE(status.ok()) << status.message;
  ASSERT_EQ(ids.poses.size(), 2u);
  ASSERT_EQ(ids.features.size(), 2u);
  EXPECT_EQ(ids.features[1], -1) << "nobody sees it again";
  EXPECT_EQ(graph_.role(ids.features[0]), Role::kLandmark);
  EXPECT_EQ(graph_.Values(ids.features[0])[0], 0.4) << "the guess";
  EXPECT_EQ(graph_.NumFactors(ids.reprojections), 1);
  EXPECT_EQ(graph_.NumFactors(ids.depths), 1);
  EXPECT_EQ(graph_.NumFactors(ids.betweens), 1);
  EXPECT_NE(graph_.loss(ids.reprojections, 0), nullptr);
  EXPECT_EQ(graph_.loss(ids.depths, 0), nullptr);
  const Summary summary = Solve(SolverOptions(), &graph_);
  EXPECT_LT(summary.final_cost, 1e-12) << summary.message;
  EXPECT_NEAR(graph_.Values(ids.features[0])[0], 0.5, 1e-5);
}

TEST_F(KeyframeGraphTest, RefusesWhatCannotBe) {
  KeyframeGraphOptions options;
  options.depth_sigma = 0.0;
  EXPECT_EQ(ReadKeyframes(Write("a.kf", TwoKeyframes()), &graph_, nullptr, options).code,
            StatusCode::kInvalidArgument);
  EXPECT_EQ(ReadKeyframes(dir_.File("missing"), &graph_).code, StatusCode::kIo);
  KeyframeSequence sequence;
  ASSERT_TRUE(ReadKeyframes(dir_.File("a.kf"), &sequence).ok());
  sequence.keyframes[1].observations[0].information = {1.0, 2.0, 1.0};
  const Status status = AddKeyframes(sequence, KeyframeGraphOptions(), &graph_, nullptr);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("keyframe 1, observation of feature 0"), std::string::npos)
      << status.message;
  sequence.keyframes[1].observations[0].feature = 1000;
  const Status missing = AddKeyframes(sequence, KeyframeGraphOptions(), &graph_, nullptr);
  EXPECT_EQ(missing.code, StatusCode::kInvalidArgument);
  EXPECT_NE(missing.message.find("keyframe 1 sees"), std::string::npos) << missing.message;
  sequence.features[0].anchor = -1;
  const Status floating = AddKeyframes(sequence, KeyframeGraphOptions(), &graph_, nullptr);
  EXPECT_EQ(floating.message, "features[0]: its anchor is no keyframe");
  EXPECT_EQ(graph_.num_variables() + graph_.num_families(), 0);
}

}  // namespace
}  // namespace inceres
