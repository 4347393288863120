// What is written is read back as it was; graphs that cannot be written are named.
#include <limits>
#include <sstream>
#include <string>

#include <gtest/gtest.h>

#include "inceres/io/g2o.h"
#include "support/pose_graph_world.h"
#include "support/temp_dir.h"

namespace inceres {
namespace {

using test::PoseGraphWorld;

TEST(WriteG2o, IsReadBackToTheLastBit) {
  test::TempDir dir;
  for (const int dimension : {2, 3}) {
    PoseGraph graph = PoseGraphWorld(dimension, 40, 10, 3, 0.1, 6).truth;
    graph.fixed = {3, 0};
    for (PoseGraphEdge& edge : graph.edges) {
      edge.information[1] = edge.information[static_cast<std::size_t>(graph.TangentSize())] = 0.25;
    }
    for (const char* name : {"graph.g2o", "graph.g2o.gz"}) {
      ASSERT_TRUE(WriteG2o(dir.File(name), graph).ok());
      PoseGraph read;
      const Status status = ReadG2o(dir.File(name), &read);
      ASSERT_TRUE(status.ok()) << status.message;
      EXPECT_EQ(read.ids, graph.ids);
      EXPECT_EQ(read.fixed, graph.fixed);
      ASSERT_EQ(read.edges.size(), graph.edges.size());
      for (std::size_t i = 0; i < graph.edges.size(); ++i) {
        EXPECT_EQ(read.edges[i].from, graph.edges[i].from);
        EXPECT_EQ(read.edges[i].to, graph.edges[i].to);
        EXPECT_EQ(read.edges[i].information, graph.edges[i].information);
        for (std::size_t k = 0; k < 3; ++k) {
          EXPECT_EQ(read.edges[i].measurement[k], graph.edges[i].measurement[k]);
        }
      }
      // Quaternions are normalized when they are read.
      for (std::size_t k = 0; k < graph.poses.size(); ++k) {
        EXPECT_NEAR(read.poses[k], graph.poses[k], dimension == 2 ? 0.0 : 1e-15);
      }
    }
  }
}

TEST(WriteTumTrajectory, HasALineAPoseById) {
  test::TempDir dir;
  PoseGraph graph;
  graph.dimension = 2;
  graph.ids = {7, 3};
  graph.poses = {1.5, 2.5, M_PI, -1.0, 4.0, 0.0};
  ASSERT_TRUE(WriteTumTrajectory(dir.File("a.txt"), graph).ok());
  std::istringstream text(test::ReadBytes(dir.File("a.txt")));
  const double expected[2][8] = {{3, -1, 4, 0, 0, 0, 0, 1}, {7, 1.5, 2.5, 0, 0, 0, 1, 0}};
  for (const auto& line : expected) {
    for (const double value : line) {
      double read = -100.0;
      text >> read;
      EXPECT_NEAR(read, value, 1e-15);
    }
  }
  graph = PoseGraphWorld(3, 12, 5, 0, 0.0, 1).truth;
  ASSERT_TRUE(WriteTumTrajectory(dir.File("b.txt"), graph).ok());
  std::istringstream spatial(test::ReadBytes(dir.File("b.txt")));
  for (int i = 0; i < 12; ++i) {
    double read = 0.0;
    spatial >> read;
    EXPECT_EQ(read, 10.0 * i);
    for (int k = 0; k < 7; ++k) {
      spatial >> read;
      EXPECT_EQ(read, graph.PoseData(i)[k]);
    }
  }
}

TEST(WriteG2o, NamesWhatDoesNotFit) {
  test::TempDir dir;
  const PoseGraph good = PoseGraphWorld(2, 12, 5, 0, 0.0, 1).truth;
  const auto refusal = [&](const PoseGraph& graph) {
    const Status status = WriteG2o(dir.File("never.g2o"), graph);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_EQ(test::ReadBytes(dir.File("never.g2o")), "");
    return status.message;
  };
  PoseGraph bad = good;
  bad.dimension = 4;
  EXPECT_NE(refusal(bad).find("dimension is 4"), std::string::npos);
  bad = good;
  bad.poses.pop_back();
  EXPECT_NE(refusal(bad).find("poses has 35 values instead of 36"), std::string::npos);
  bad = good;
  bad.poses[4] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(refusal(bad).find("poses[4]"), std::string::npos);
  bad = good;
  bad.edges[2].to = 12;
  EXPECT_NE(refusal(bad).find("edges[2]"), std::string::npos);
  bad = good;
  bad.edges[3].information[8] = std::numeric_limits<double>::infinity();
  EXPECT_NE(refusal(bad).find("edges[3]"), std::string::npos);
  bad = good;
  bad.fixed = {99};
  EXPECT_NE(refusal(bad).find("fixed[0]"), std::string::npos);
  const Status nowhere = WriteG2o(dir.File("no/folder.g2o"), good);
  EXPECT_EQ(nowhere.code, StatusCode::kIo);
}

}  // namespace
}  // namespace inceres
