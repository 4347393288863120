// What a two-level preconditioner is made of: shared frames, modes of frames, products with S.
#include <algorithm>
#include <memory>
#include <numeric>
#include <vector>

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "schur/covisibility.h"
#include "schur/elimination.h"
#include "schur/frame_aggregates.h"
#include "schur/gauge_modes.h"
#include "schur/projected_products.h"
#include "support/core_pipeline.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"
#include "support/street_graph.h"

namespace inceres::internal {
namespace {

using test::CorePipeline;
using test::MakeStreetGraph;
using test::StreetGraphOptions;

constexpr std::int64_t kWholeY = std::int64_t{1} << 40;

StreetGraphOptions Small() {
  StreetGraphOptions options;
  options.num_cameras = 14;
  options.points_per_camera = 8;
  return options;
}

StreetGraphOptions Split(bool shared_focal) {
  StreetGraphOptions options = Small();
  options.split = true;
  options.shared_focal = shared_focal;
  return options;
}

// ‖J v‖² / ‖J_c v_c‖² for frames that move by a mode, and landmarks so that the factors feel the
// least of it.
double RelativeMotion(const test::DenseOracle& oracle, const CorePipeline& core,
                      const GaugeModes& modes, int mode) {
  const Layout& layout = core.layout;
  const int n_c = layout.frame_size(), n_l = layout.size() - n_c;
  Eigen::VectorXd v(n_c + n_l);
  for (int i = 0; i < layout.num_frames; ++i) {
    for (int r = 0; r < layout.TangentSize(i); ++r) {
      v(layout.packed_offset[static_cast<std::size_t>(i)] + r) =
          modes.fit().Of(i)[r * kGaugeStride + mode];
    }
  }
  const Eigen::MatrixXd W = oracle.H.topRightCorner(n_c, n_l);
  v.tail(n_l) = -oracle.H.bottomRightCorner(n_l, n_l).llt().solve(W.transpose() * v.head(n_c));
  return v.dot(oracle.H * v) / v.head(n_c).dot(oracle.H.topLeftCorner(n_c, n_c) * v.head(n_c));
}

class GaugeModesTest : public ::testing::TestWithParam<StreetGraphOptions> {};

TEST_P(GaugeModesTest, AreMotionsThatFactorsDoNotFeel) {
  const auto street = MakeStreetGraph(GetParam());
  const CorePipeline core(street->graph);
  ASSERT_TRUE(core.status.ok()) << core.status.message;
  Status status;
  GaugeModes modes(core.evaluator, FindSharedFrames(core.evaluator), &status);
  ASSERT_TRUE(status.ok()) << status.message;
  ASSERT_TRUE(modes.AreEuclidean());
  ASSERT_TRUE(modes.Compute());
  const test::DenseOracle oracle(street->graph, core.layout.variables);
  for (int mode = 0; mode < kGaugeModes; ++mode) {
    EXPECT_LT(modes.fit().misfit()[mode], 1e-10) << mode;
    EXPECT_LT(RelativeMotion(oracle, core, modes, mode), 1e-8) << mode;
  }
}

INSTANTIATE_TEST_SUITE_P(Blocks, GaugeModesTest,
                         ::testing::Values(Small(), Split(false), Split(true)));

TEST(GaugeModesFallback, IsTakenWherePointsAreNotEuclidean) {
  StreetGraphOptions options = Small();
  options.inverse_depth = true;  // three numbers, but not a place
  const auto street = MakeStreetGraph(options);
  const CorePipeline core(street->graph);
  Status status;
  GaugeModes modes(core.evaluator, FindSharedFrames(core.evaluator), &status);
  EXPECT_TRUE(modes.AreEuclidean());
  EXPECT_FALSE(modes.Compute());
  EXPECT_GT(*std::max_element(modes.fit().misfit(), modes.fit().misfit() + kGaugeModes), 0.01);

  test::BundleOptions inverse_depths;
  inverse_depths.landmark_sizes = {1};
  const auto bundle = test::MakeBundle(inverse_depths);
  const CorePipeline other(bundle->graph());
  GaugeModes none(other.evaluator, FindSharedFrames(other.evaluator), &status);
  EXPECT_FALSE(none.AreEuclidean());
  EXPECT_FALSE(none.Compute());
}

TEST(SharedFrames, AreThoseThatManyCamerasHaveInCommon) {
  for (const bool shared : {false, true}) {
    const auto street = MakeStreetGraph(Split(shared));
    const CorePipeline core(street->graph);
    const std::vector<char> is_shared = FindSharedFrames(core.evaluator);
    EXPECT_EQ(std::count(is_shared.begin(), is_shared.end(), 1), shared ? 1 : 0);
    if (shared) {
      const int focal = core.layout.FrameOf(street->focals[0]);
      EXPECT_EQ(is_shared[static_cast<std::size_t>(focal)], 1);
    }
  }
}

TEST(FrameAggregatesTest, KeepTheBlocksOfACameraTogether) {
  StreetGraphOptions options = Split(true);
  options.num_cameras = 40;
  const auto street = MakeStreetGraph(options);
  const CorePipeline core(street->graph);
  const FrameAggregates aggregates(core.evaluator, core.incidences, /*forms_S=*/false);
  const int focal = core.layout.FrameOf(street->focals[0]);
  const std::vector<int>& part_of = aggregates.clusters.cluster_of;
  const auto with_focal =
      std::count(part_of.begin(), part_of.end(), part_of[static_cast<std::size_t>(focal)]);
  EXPECT_EQ(with_focal, 1);
  EXPECT_GT(aggregates.count, 4);
  EXPECT_LT(aggregates.count, core.layout.num_frames / 4);
}

// A V by landmarks, and by the blocks of S, against the dense product; with damping.
TEST(ProjectedProductsTest, AreThoseOfTheDenseMatrix) {
  for (const bool mixed : {false, true}) {
    test::BundleOptions options;
    options.num_frames = 24;
    options.num_landmarks = 90;
    options.frame_sizes = mixed ? std::vector<int>{6, 3, 9} : std::vector<int>{6};
    options.landmark_sizes = mixed ? std::vector<int>{3, 1, 2, 4} : std::vector<int>{3};
    options.hosted = mixed;
    options.constants = true;
    const auto bundle = test::MakeBundle(options);
    for (const bool forms_S : {false, true}) {
      CorePipeline core(bundle->graph(), true, 2, kWholeY);
      const LandmarkIncidences incidences(core.evaluator, kWholeY, /*may_have_tail=*/forms_S);
      const FrameAggregates aggregates(core.evaluator, incidences, forms_S);
      const FramePlans plans(core.evaluator, incidences,
                             forms_S ? SchurBlocks::kAll : SchurBlocks::kClustered,
                             &aggregates.clusters);
      Hessian hessian(core.evaluator, incidences, plans);
      hessian.Accumulate();
      Elimination elimination(core.evaluator, incidences, plans, hessian);
      const std::vector<double> damping(static_cast<std::size_t>(core.layout.size()), 0.7);
      ASSERT_TRUE(elimination.Eliminate(damping.data() + core.layout.frame_size()).ok());
      std::vector<const double*> blocks;
      for (std::size_t k = 0; k < plans.block_row.size(); ++k) {
        blocks.push_back(forms_S ? elimination.S() + plans.pattern.value_begin[k]
                                 : hessian.FrameBlock(static_cast<int>(k)));
      }
      const AggregateReach reach(aggregates,
                                 std::vector<int>(static_cast<std::size_t>(aggregates.count), 5),
                                 incidences, plans.pattern);
      CoarseColumns space(plans.pattern.offsets, reach.shape, core.executor);
      const int n_c = core.layout.frame_size(), n_l = core.layout.size() - n_c;
      Eigen::MatrixXd V = Eigen::MatrixXd::Zero(n_c, 5 * aggregates.count);
      test::Random random(5);
      for (int i = 0; i < core.layout.num_frames; ++i) {
        const int a = reach.shape.aggregate_of[static_cast<std::size_t>(i)];
        for (int r = 0; r < space.block_size(i); ++r) {
          for (int k = 0; k < 5; ++k) {
            space.V(i)[r * space.stride(a) + k] = random.Between(-1.0, 1.0);
            V(plans.pattern.offsets[static_cast<std::size_t>(i)] + r, 5 * a + k) =
                space.V(i)[r * space.stride(a) + k];
          }
        }
      }
      ProjectedProducts(incidences, plans, blocks, forms_S ? nullptr : &elimination)
          .Form(reach, damping.data(), core.executor, &space);

      Eigen::MatrixXd H = test::DenseOracle(bundle->graph(), core.layout.variables).H;
      H.diagonal().array() += 0.7;
      const Eigen::MatrixXd W = H.topRightCorner(n_c, n_l);
      const Eigen::MatrixXd A =
          H.topLeftCorner(n_c, n_c) - W * H.bottomRightCorner(n_l, n_l).llt().solve(W.transpose());
      Eigen::MatrixXd AV = Eigen::MatrixXd::Zero(n_c, V.cols());
      for (int a = 0; a < aggregates.count; ++a) {
        for (int place = reach.shape.coupled_begin[static_cast<std::size_t>(a)];
             place < reach.shape.coupled_begin[static_cast<std::size_t>(a) + 1]; ++place) {
          const int i = reach.shape.coupled[static_cast<std::size_t>(place)];
          for (int r = 0; r < space.block_size(i); ++r) {
            for (int k = 0; k < 5; ++k) {
              AV(plans.pattern.offsets[static_cast<std::size_t>(i)] + r, 5 * a + k) =
                  space.AV(place)[r * space.stride(a) + k];
            }
          }
        }
      }
      EXPECT_LT(test::RelativeError(AV, A * V), 1e-11) << mixed << forms_S;
    }
  }
}

}  // namespace
}  // namespace inceres::internal
