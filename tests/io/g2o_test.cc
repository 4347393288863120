#include "inceres/io/g2o.h"

#include <cmath>
#include <string>

#include <gtest/gtest.h>

#include "support/temp_dir.h"
#include "support/test_data.h"

namespace inceres {
namespace {

using test::TempDir;
using test::WriteBytes;

class G2oTest : public ::testing::Test {
 protected:
  Status ReadText(const std::string& text) {
    WriteBytes(dir_.File("graph.g2o"), text);
    return ReadG2o(dir_.File("graph.g2o"), &graph_);
  }

  void ExpectError(const std::string& text, int line, const std::string& what) {
    graph_ = PoseGraph();
    graph_.dimension = 77;
    const Status status = ReadText(text);
    EXPECT_EQ(status.code, StatusCode::kIo) << what;
    const std::string expected = dir_.File("graph.g2o") + ":" + std::to_string(line) + ": " + what;
    EXPECT_EQ(status.message.substr(0, expected.size()), expected) << status.message;
    EXPECT_EQ(graph_.dimension, 77);
    EXPECT_TRUE(graph_.ids.empty());
  }

  TempDir dir_;
  PoseGraph graph_;
};

const std::string kVertices2d = "VERTEX_SE2 7 1 2 0.5\nVERTEX_SE2 3 4 5 -0.5\n";
const std::string kVertices3d =
    "VERTEX_SE3:QUAT 0 1 2 3 0 0 0 1\nVERTEX_SE3:QUAT 1 4 5 6 0 0 0 2\n";

TEST_F(G2oTest, Planar) {
  // An edge before its vertices, comments, blank lines, Windows line ends, ids with gaps.
  const Status status = ReadText("# planar\r\n\r\nEDGE_SE2 3 7 0.1 0.2 0.3 11 12 13 22 23 33\r\n" +
                                 kVertices2d + "FIX 3 7\nFIX 3\n");
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(graph_.dimension, 2);
  EXPECT_EQ(graph_.ids, (std::vector<std::int64_t>{7, 3}));
  EXPECT_EQ(graph_.poses, (std::vector<double>{1, 2, 0.5, 4, 5, -0.5}));
  ASSERT_EQ(graph_.edges.size(), 1u);
  EXPECT_EQ(graph_.edges[0].from, 1);
  EXPECT_EQ(graph_.edges[0].to, 0);
  EXPECT_EQ(graph_.edges[0].measurement[2], 0.3);
  const double expected[9] = {11, 12, 13, 12, 22, 23, 13, 23, 33};
  EXPECT_TRUE(std::equal(expected, expected + 9, graph_.edges[0].information.begin()));
  EXPECT_EQ(graph_.fixed, (std::vector<int>{1, 0}));
}

TEST_F(G2oTest, Spatial) {
  std::string edge = "EDGE_SE3:QUAT 0 1 1 2 3 0 0 3 4";
  for (int i = 0; i < 21; ++i) {
    edge += " " + std::to_string(100 + i);
  }
  const Status status = ReadText(kVertices3d + edge);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(graph_.dimension, 3);
  EXPECT_EQ(graph_.PoseData(1)[6], 1.0);  // normalized
  ASSERT_EQ(graph_.edges.size(), 1u);
  EXPECT_DOUBLE_EQ(graph_.edges[0].measurement[5], 0.6);
  EXPECT_DOUBLE_EQ(graph_.edges[0].measurement[6], 0.8);
  const auto& information = graph_.edges[0].information;
  EXPECT_EQ(information[0], 100.0);
  EXPECT_EQ(information[1], 101.0);
  EXPECT_EQ(information[6], 101.0);
  EXPECT_EQ(information[7], 106.0);
  EXPECT_EQ(information[35], 120.0);
}

// Turned left by 90° after a meter, thrice: a square. The edge 0-30 goes backwards, 10-40 jumps
// ahead.
TEST_F(G2oTest, EdgesAloneStartAlongTheOdometry) {
  const std::string turn = " 1 0 1.5707963267948966 1 0 0 1 0 1\n";
  const Status status =
      ReadText("EDGE_SE2 10 40 9 9 9 1 0 0 1 0 1\nEDGE_SE2 20 30" + turn + "EDGE_SE2 10 20" + turn +
               "EDGE_SE2 50 30 1 0 0 1 0 0 1 0 1\nEDGE_SE2 30 40" + turn + "FIX 20\n");
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(graph_.ids, (std::vector<std::int64_t>{10, 20, 30, 40, 50}));
  EXPECT_EQ(graph_.fixed, (std::vector<int>{1}));
  // 50 sees 30, at (1, 1) and turned by 180°, one meter ahead of it.
  const double expected[15] = {0, 0, 0, 1, 0, M_PI / 2, 1, 1, M_PI, 0, 1, 1.5 * M_PI, 2, 1, M_PI};
  ASSERT_EQ(graph_.poses.size(), 15u);
  for (std::size_t k = 0; k < 15; ++k) {
    EXPECT_NEAR(graph_.poses[k], expected[k], 1e-14) << k;
  }
}

TEST_F(G2oTest, SpatialEdgesAlone) {
  const std::string information = " 1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1\n";
  const Status status = ReadText("EDGE_SE3:QUAT 0 1 1 2 3 0 0 1 1" + information +
                                 "EDGE_SE3:QUAT 2 1 1 0 0 0 0 0 1" + information);
  ASSERT_TRUE(status.ok()) << status.message;
  const double half = std::sqrt(0.5);
  const double expected[21] = {0, 0,    0,    0, 0, 0, 1, 1, 2,    3,   0,
                               0, half, half, 1, 1, 3, 0, 0, half, half};
  ASSERT_EQ(graph_.poses.size(), 21u);
  for (std::size_t k = 0; k < 21; ++k) {
    EXPECT_NEAR(graph_.poses[k], expected[k], 1e-14) << k;
  }
}

TEST_F(G2oTest, EdgesAloneMustHangTogether) {
  const std::string edge = " 1 0 0 1 0 0 1 0 1\n";
  ExpectError("EDGE_SE2 3 4" + edge + "EDGE_SE2 7 8" + edge, 3,
              "the file has no VERTEX lines, and no edges lead from vertex 3 to vertex 7");
  ExpectError("EDGE_SE2 3 4" + edge + "FIX 5\n", 2, "FIX: id: the file has no vertex 5");
}

TEST_F(G2oTest, ErrorsNameLineTagAndField) {
  ExpectError(kVertices2d + "VERTEX_XY 1 2 3\n", 3, "VERTEX_XY: tag: not known");
  ExpectError(kVertices2d + kVertices3d, 3,
              "VERTEX_SE3:QUAT: tag: planar and spatial poses in one file");
  ExpectError("VERTEX_SE2 0 1 2\n" + kVertices2d, 1,
              "VERTEX_SE2: theta: missing, the line ends here");
  ExpectError("VERTEX_SE2 0 1 2", 1, "VERTEX_SE2: theta: missing, the file ends here");
  ExpectError("VERTEX_SE2 0 1 2 3 4\n", 1, "VERTEX_SE2: after the last field: unexpected '4'");
  ExpectError("VERTEX_SE2 x 1 2 3\n", 1, "VERTEX_SE2: id: 'x' is not an integer");
  ExpectError("VERTEX_SE2 -1 1 2 3\n", 1, "VERTEX_SE2: id: -1 is negative");
  ExpectError("VERTEX_SE2 0 1 nan 3\n", 1, "VERTEX_SE2: y: 'nan' is not a finite number");
  ExpectError(kVertices2d + "VERTEX_SE2 7 1 2 3\n", 3,
              "VERTEX_SE2: id: vertex 7 is in the file twice");
  ExpectError("VERTEX_SE3:QUAT 0 1 2 3 0 0 0 0\n", 1,
              "VERTEX_SE3:QUAT: quaternion: its length is 0");
  ExpectError(kVertices2d + "EDGE_SE2 7 8 1 2 3 1 0 0 1 0 1\n\n", 3,
              "EDGE_SE2: to: the file has no vertex 8");
  ExpectError(kVertices2d + "\nEDGE_SE2 9 7 1 2 3 1 0 0 1 0 1\n", 4,
              "EDGE_SE2: from: the file has no vertex 9");
  ExpectError(kVertices2d + "EDGE_SE2 7 7 1 2 3 1 0 0 1 0 1\n", 3,
              "EDGE_SE2: to: an edge from vertex 7 to itself");
  ExpectError(kVertices2d + "EDGE_SE2 7 3 1 2 3 1 0 0 -1 0 1\n", 3,
              "EDGE_SE2: information(1, 1): negative on the diagonal");
  ExpectError(kVertices2d + "EDGE_SE2 7 3 1 2 3 1 0 0 1 0\n", 3,
              "EDGE_SE2: information(2, 2): missing, the line ends here");
  ExpectError(kVertices2d + "FIX 4\n", 3, "FIX: id: the file has no vertex 4");
  ExpectError(kVertices2d + "FIX\n", 3, "FIX: id: missing, the line ends here");
  ExpectError("# nothing\n", 2, "the file has no vertices");
  EXPECT_EQ(ReadG2o(dir_.File("no_such.g2o"), &graph_).message,
            dir_.File("no_such.g2o") + ": cannot open for reading: No such file or directory");
}

struct PublicGraph {
  const char* name;
  int dimension;
  int num_vertices;
  std::size_t num_edges;
};

class PublicG2o : public ::testing::TestWithParam<PublicGraph> {};

TEST_P(PublicG2o, Reads) {
  const std::string path = test::FindData(GetParam().name);
  if (path.empty()) {
    GTEST_SKIP() << test::MissingData(GetParam().name);
  }
  PoseGraph graph;
  const Status status = ReadG2o(path, &graph);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_EQ(graph.dimension, GetParam().dimension);
  EXPECT_EQ(graph.NumVertices(), GetParam().num_vertices);
  EXPECT_EQ(graph.edges.size(), GetParam().num_edges);
  EXPECT_EQ(graph.poses.size(), static_cast<std::size_t>(graph.NumVertices() * graph.PoseSize()));
}

INSTANTIATE_TEST_SUITE_P(All, PublicG2o,
                         ::testing::Values(PublicGraph{"pose_graph/M3500.g2o", 2, 3500, 5453},
                                           PublicGraph{"pose_graph/sphere.g2o", 3, 2500, 9799},
                                           PublicGraph{"pose_graph/kitti_05.g2o", 2, 2761, 2826}),
                         [](const auto& instance) {
                           return "V" + std::to_string(instance.param.num_vertices);
                         });

}  // namespace
}  // namespace inceres
