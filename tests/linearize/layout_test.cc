#include "linearize/layout.h"

#include <gtest/gtest.h>

#include "inceres/problem/manifolds.h"
#include "simd/kernels.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::RandomGraph;

// Variables 0: landmark of size 3; 1: frame of size 6; 2: constant frame; 3: untouched frame; 4:
// landmark of size 1; 5: frame of size 9; 6: borrowed; 7: constant landmark; 8: pose (tangent 6 of
// 7); 9: subset manifold with nothing free. Factors meet landmark 4 before landmark 0.
std::unique_ptr<RandomGraph> MakeMixed() {
  auto random = std::make_unique<RandomGraph>(1);
  random->AddLandmark(3);
  random->AddFrame(6);
  random->graph().SetConstant(random->AddFrame(6), true);
  random->AddFrame(2);
  random->AddLandmark(1);
  random->AddFrame(9);
  random->AddBorrowed(4);
  random->graph().SetConstant(random->AddLandmark(3), true);
  random->AddFrame(std::make_shared<PoseManifold>());
  random->AddFrame(std::make_shared<SubsetManifold>(2, std::vector<int>{0, 1}));
  random->Connect(2, {5, 4});
  random->Connect(2, {1, 0});
  random->Connect(2, {2, 7});
  random->Connect(2, {6, 4});
  random->Connect(3, {8, 9});
  return random;
}

TEST(Layout, FramesInOrderThenLandmarksAsFactorsMeetThem) {
  const auto random = MakeMixed();
  const Layout layout(random->graph(), /*eliminate_landmarks=*/true);
  EXPECT_EQ(layout.variables, (std::vector<VariableId>{1, 5, 8, 4, 0}));
  EXPECT_EQ(layout.num_frames, 3);
  EXPECT_EQ(layout.num_landmarks(), 2);
  EXPECT_EQ(layout.packed_offset, (std::vector<int>{0, 6, 15, 21, 22, 25}));
  EXPECT_EQ(layout.quad_offset, (std::vector<std::int32_t>{0, 2, 5, 7, 8, 9}));
  EXPECT_EQ(layout.frame_size(), 21);
  EXPECT_EQ(layout.size(), 25);
  EXPECT_EQ(layout.TangentSize(2), 6);
}

TEST(Layout, IndicesOfVariablesThatStandStillAreNegative) {
  const auto random = MakeMixed();
  const Layout layout(random->graph(), true);
  for (const VariableId still : {2, 3, 6, 7, 9}) {
    EXPECT_EQ(layout.position[static_cast<std::size_t>(still)], -1) << still;
    EXPECT_EQ(layout.FrameOf(still), -1) << still;
    EXPECT_EQ(layout.LandmarkOf(still), -1) << still;
  }
  EXPECT_EQ(layout.FrameOf(5), 1);
  EXPECT_EQ(layout.LandmarkOf(5), -1);
  EXPECT_EQ(layout.LandmarkOf(4), 0);
  EXPECT_EQ(layout.LandmarkOf(0), 1);
  EXPECT_EQ(layout.FrameOf(0), -1);
}

TEST(Layout, WithoutEliminationEveryMovingVariableIsAFrame) {
  const auto random = MakeMixed();
  const Layout layout(random->graph(), false);
  EXPECT_EQ(layout.variables, (std::vector<VariableId>{0, 1, 4, 5, 8}));
  EXPECT_EQ(layout.num_frames, 5);
  EXPECT_EQ(layout.num_landmarks(), 0);
  EXPECT_EQ(layout.frame_size(), layout.size());
}

TEST(Layout, PaddingStaysZeroAndEntriesKeepTheirOrder) {
  const auto random = MakeMixed();
  const Layout layout(random->graph(), true);
  const std::vector<double> packed = random->random().Vector(25);
  std::vector<double> padded(9 * kQuad, 0.0);
  layout.Pad(packed.data(), padded.data());
  std::size_t next = 0;
  for (std::size_t i = 0; i < layout.variables.size(); ++i) {
    for (int k = 0; k < (layout.quad_offset[i + 1] - layout.quad_offset[i]) * kQuad; ++k) {
      const double entry = padded[static_cast<std::size_t>(layout.quad_offset[i] * kQuad + k)];
      EXPECT_EQ(entry, k < layout.TangentSize(static_cast<int>(i)) ? packed[next++] : 0.0);
    }
  }
  EXPECT_EQ(next, packed.size());
}

TEST(Layout, EmptyGraphs) {
  const Layout nothing(FactorGraph(), true);
  EXPECT_EQ(nothing.size(), 0);
  RandomGraph lonely(1);
  lonely.AddFrame(3);
  EXPECT_TRUE(Layout(lonely.graph(), true).variables.empty());
}

}  // namespace
}  // namespace inceres::internal
