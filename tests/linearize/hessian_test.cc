// C, P, gradient and diagonal against the dense oracle.
#include "linearize/hessian.h"

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "support/core_pipeline.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::BundleOptions;
using test::CorePipeline;
using test::DenseOracle;
using test::MakeBundle;
using test::RandomGraph;
using test::RelativeError;

constexpr double kTolerance = 1e-10;

void ExpectEqualsOracle(const FactorGraph& graph, bool eliminate_landmarks) {
  const Status valid = graph.Validate();
  ASSERT_TRUE(valid.ok()) << valid.message;
  const CorePipeline core(graph, eliminate_landmarks);
  ASSERT_TRUE(core.status.ok()) << core.status.message;
  const DenseOracle oracle(graph, core.layout.variables);
  EXPECT_NEAR(core.cost, oracle.cost, kTolerance * oracle.cost);
  const int num_frame_columns = core.layout.frame_size();
  EXPECT_LT(RelativeError(test::ToDense(core.plans.pattern, test::FrameHessian(core).data()),
                          oracle.H.topLeftCorner(num_frame_columns, num_frame_columns)),
            kTolerance);
  const Eigen::Map<const Eigen::VectorXd> gradient(core.hessian.gradient().data(),
                                                   core.layout.size());
  EXPECT_LT(RelativeError(gradient, oracle.g), kTolerance);
  const Eigen::Map<const Eigen::VectorXd> diagonal(core.hessian.diagonal().data(),
                                                   core.layout.size());
  EXPECT_LT(RelativeError(diagonal, oracle.H.diagonal()), kTolerance);
  for (int l = 0; l < core.layout.num_landmarks(); ++l) {
    const int first =
        core.layout.packed_offset[static_cast<std::size_t>(core.layout.num_frames + l)];
    const int size = core.layout.TangentSize(core.layout.num_frames + l);
    Eigen::Matrix<double, 4, 4, Eigen::RowMajor> P;
    Eigen::Vector4d eta;
    core.hessian.GetP(l, P.data());
    core.hessian.GetLandmarkEta(l, eta.data());
    const Eigen::MatrixXd whole = P.topLeftCorner(size, size).selfadjointView<Eigen::Lower>();
    EXPECT_LT(RelativeError(whole, oracle.H.block(first, first, size, size)), kTolerance);
    EXPECT_LT(RelativeError(eta.head(size), -oracle.g.segment(first, size)), kTolerance);
  }
}

void ExpectEqualsOracle(const FactorGraph& graph) {
  ExpectEqualsOracle(graph, true);
  ExpectEqualsOracle(graph, false);
}

class HessianOfBundle : public testing::TestWithParam<unsigned> {};

TEST_P(HessianOfBundle, MixedSizes) {
  BundleOptions options;
  options.seed = GetParam();
  options.frame_sizes = {6, 9, 15, 3, 1, 7};
  options.landmark_sizes = {1, 2, 3, 4};
  options.residual_sizes = {2, 3, 1, 4, 5, 17};
  ExpectEqualsOracle(MakeBundle(options)->graph());
}

TEST_P(HessianOfBundle, ManifoldsLossesConstantsAndHosts) {
  BundleOptions options;
  options.seed = GetParam();
  options.num_frames = 12;
  options.num_landmarks = 60;
  options.landmark_sizes = {3, 1};
  options.residual_sizes = {2, 3};
  options.hosted = true;
  options.manifolds = true;
  options.losses = true;
  options.constants = true;
  options.perturbation = 0.2;
  ExpectEqualsOracle(MakeBundle(options)->graph());
}

TEST_P(HessianOfBundle, FramesAbove16) {
  BundleOptions options;
  options.seed = GetParam();
  options.num_frames = 4;
  options.frame_sizes = {6, 33, 21};
  ExpectEqualsOracle(MakeBundle(options)->graph());
}

INSTANTIATE_TEST_SUITE_P(Seeds, HessianOfBundle, testing::Values(11u, 12u, 13u));

TEST(Hessian, LandmarksSeenInEveryUnusualWay) {
  RandomGraph random(21);
  const VariableId frame = random.AddFrame(6);
  const VariableId other = random.AddFrame(std::make_shared<PoseManifold>());
  const VariableId still = random.AddFrame(6);
  random.graph().SetConstant(still, true);
  const VariableId borrowed = random.AddBorrowed(6);
  const VariableId twice = random.AddLandmark(3);     // by the same frame, also with another family
  const VariableId once = random.AddLandmark(3);      // a single factor
  const VariableId unmoved = random.AddLandmark(3);   // constant frames only
  const VariableId by_prior = random.AddLandmark(2);  // a factor without frames
  const VariableId curved = random.AddLandmark(std::make_shared<SphereManifold>(3));
  random.Connect(2, {frame, twice});
  random.Connect(2, {frame, twice}, std::make_shared<HuberLoss>(0.1));
  random.Connect(3, {frame, twice});
  random.Connect(2, {other, once});
  random.Connect(2, {still, unmoved});
  random.Connect(2, {borrowed, unmoved});
  random.Connect(2, {by_prior});
  random.Connect(2, {frame, curved, other});  // through two slots
  random.Connect(2, {other, curved, frame});
  random.Connect(4, {still, borrowed});  // nothing of it moves, but it costs
  random.Connect(15, {frame, other});
  ExpectEqualsOracle(random.graph());
}

// A subset manifold is a selection, a Euclidean one the identity; both must give what the dense
// product gives.
TEST(Hessian, EveryKindOfTangentMap) {
  RandomGraph random(22);
  const VariableId identity = random.AddFrame(std::make_shared<EuclideanManifold>(5));
  const VariableId selection =
      random.AddFrame(std::make_shared<SubsetManifold>(7, std::vector<int>{0, 3, 6}));
  const VariableId dense = random.AddFrame(std::make_shared<SE3Manifold>());
  const VariableId landmark =
      random.AddLandmark(std::make_shared<SubsetManifold>(4, std::vector<int>{2}));
  random.Connect(3, {identity, selection});
  random.Connect(3, {selection, dense});
  random.Connect(2, {dense, landmark, identity});
  random.Connect(2, {selection, landmark});
  ExpectEqualsOracle(random.graph());
}

TEST(Hessian, SameBitsForAnyNumberOfThreads) {
  BundleOptions options;
  options.num_frames = 30;
  options.num_landmarks = 700;
  options.landmark_sizes = {3, 1};
  options.losses = true;
  const auto bundle = MakeBundle(options);
  const CorePipeline one(bundle->graph(), true, 1);
  for (const int num_threads : {2, 4}) {
    const CorePipeline many(bundle->graph(), true, num_threads);
    EXPECT_EQ(one.cost, many.cost);
    EXPECT_EQ(one.hessian.C(), many.hessian.C());
    EXPECT_EQ(one.hessian.gradient(), many.hessian.gradient());
    EXPECT_EQ(one.hessian.diagonal(), many.hessian.diagonal());
  }
}

// The oracle itself: its gradient against central differences of the robust cost along every
// tangent direction.
TEST(DenseOracle, GradientEqualsCentralDifferences) {
  BundleOptions options;
  options.num_landmarks = 6;
  options.manifolds = true;
  options.losses = true;
  options.perturbation = 0.1;
  const auto bundle = MakeBundle(options);
  const FactorGraph& graph = bundle->graph();
  const Layout layout(graph, true);
  const DenseOracle oracle(graph, layout.variables);
  EXPECT_NEAR(oracle.cost, test::CostAt(graph, graph.state()), 1e-12 * oracle.cost);
  Executor executor(1);
  Evaluator evaluator(graph, layout, executor);
  const double h = 1e-5;
  for (int k = 0; k < layout.size(); ++k) {
    std::vector<double> delta(static_cast<std::size_t>(layout.size()), 0.0);
    delta[static_cast<std::size_t>(k)] = h;
    ASSERT_TRUE(evaluator.points().MoveCandidate(delta.data()));
    const double ahead = test::CostAt(graph, evaluator.points().candidate());
    delta[static_cast<std::size_t>(k)] = -h;
    ASSERT_TRUE(evaluator.points().MoveCandidate(delta.data()));
    const double behind = test::CostAt(graph, evaluator.points().candidate());
    EXPECT_NEAR((ahead - behind) / (2.0 * h), oracle.g[k], 1e-7 * (1.0 + oracle.g.norm()))
        << "direction " << k;
  }
}

// Each frame with itself and with the next; frames that share landmarks only have no block of C
// between them, though S has one.
TEST(Hessian, StoresOnlyTheBlocksThatFactorsReach) {
  BundleOptions options;
  options.num_frames = 5;
  options.frame_sizes = {6};
  const std::unique_ptr<RandomGraph> bundle = MakeBundle(options);
  const CorePipeline core(bundle->graph());
  ASSERT_TRUE(core.status.ok()) << core.status.message;
  EXPECT_EQ(core.hessian.C().size(), 9u * 36u);
  EXPECT_GT(core.plans.pattern.value_begin.back(), 9 * 36);
}

}  // namespace
}  // namespace inceres::internal
