// S, b and back-substitution against the dense system (H + Λ) δ = −g.
#include "schur/elimination.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include <Eigen/Cholesky>
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

Eigen::VectorXd Solve(const Eigen::MatrixXd& A, const Eigen::VectorXd& b) {
  return A.llt().solve(b);
}

constexpr std::int64_t kOneChunk = LandmarkIncidences::kQuadsPerChunk;

// Without a block of S: b, and W P⁻¹ Wᵀ v, which come from the Jacobians.
void ExpectDenseProducts(const CorePipeline& core, const DenseOracle& oracle,
                         const Eigen::VectorXd& damping) {
  const Layout& layout = core.layout;
  const int n_c = layout.frame_size(), n_l = layout.size() - n_c;
  const FramePlans plans(core.evaluator, core.incidences, SchurBlocks::kNone);
  Hessian hessian(core.evaluator, core.incidences, plans);
  hessian.Accumulate();
  Elimination elimination(core.evaluator, core.incidences, plans, hessian);
  ASSERT_TRUE(elimination.Eliminate(damping.data() + n_c).ok());
  Eigen::MatrixXd H = oracle.H;
  H.diagonal() += damping;
  const Eigen::MatrixXd W = H.topRightCorner(n_c, n_l);
  const Eigen::LLT<Eigen::MatrixXd> P(H.bottomRightCorner(n_l, n_l));
  const Eigen::Map<const Eigen::VectorXd> b(elimination.b(), n_c);
  EXPECT_LT(RelativeError(b, -oracle.g.head(n_c) + W * P.solve(oracle.g.tail(n_l))), 1e-9);

  const Eigen::VectorXd v = Eigen::VectorXd::LinSpaced(n_c, -1.0, 2.0);
  const int num_quads = layout.quad_offset[layout.num_frames];
  AlignedVector<double> padded(num_quads * kQuad), product(num_quads * kQuad);
  for (int i = 0; i < layout.num_frames; ++i) {
    std::copy(v.data() + layout.packed_offset[i], v.data() + layout.packed_offset[i + 1],
              padded.data() + layout.quad_offset[i] * kQuad);
  }
  elimination.SubtractReduced(padded.data(), product.data());
  Eigen::VectorXd packed(n_c);
  for (int i = 0; i < layout.num_frames; ++i) {
    const int size = layout.TangentSize(i);
    std::copy_n(product.data() + layout.quad_offset[i] * kQuad, size,
                packed.data() + layout.packed_offset[i]);
  }
  // Without the damping of the frames.
  const Eigen::MatrixXd C = oracle.H.topLeftCorner(n_c, n_c);
  EXPECT_LT(RelativeError(packed, W * P.solve(W.transpose() * v) - C * v), 1e-10);
}

// Landmarks eliminated by the core, the reduced system solved by Eigen, against everything solved
// by Eigen.
void ExpectDenseStep(const FactorGraph& graph, const Eigen::VectorXd& damping,
                     std::int64_t quads_per_chunk) {
  const CorePipeline core(graph, true, 1, quads_per_chunk);
  ASSERT_TRUE(core.status.ok()) << core.status.message;
  const DenseOracle oracle(graph, core.layout.variables);
  const int n_c = core.layout.frame_size();
  const int n_l = core.layout.size() - n_c;
  ASSERT_EQ(damping.size(), n_c + n_l);
  Elimination elimination(core.evaluator, core.incidences, core.plans, core.hessian);
  const Status eliminated = elimination.Eliminate(damping.data() + n_c);
  ASSERT_TRUE(eliminated.ok()) << eliminated.message;

  Eigen::MatrixXd H = oracle.H;
  H.diagonal() += damping;
  const Eigen::MatrixXd S = test::ToDense(core.plans.pattern, elimination.S());
  const Eigen::Map<const Eigen::VectorXd> b(elimination.b(), n_c);
  if (n_c > 0) {
    const Eigen::MatrixXd W = H.topRightCorner(n_c, n_l);
    const Eigen::LLT<Eigen::MatrixXd> P(H.bottomRightCorner(n_l, n_l));
    EXPECT_LT(RelativeError(S, oracle.H.topLeftCorner(n_c, n_c) - W * P.solve(W.transpose())),
              1e-10);
    EXPECT_LT(RelativeError(b, -oracle.g.head(n_c) + W * P.solve(oracle.g.tail(n_l))), 1e-9);
    ExpectDenseProducts(core, oracle, damping);
  }

  Eigen::VectorXd step(n_c + n_l);
  if (n_c > 0) {
    step.head(n_c) = Solve(S + Eigen::MatrixXd(damping.head(n_c).asDiagonal()), b);
  }
  elimination.BackSubstitute(step.data(), step.data() + n_c);
  EXPECT_LT(RelativeError(step, Solve(H, -oracle.g)), 1e-9);
  EXPECT_GT(elimination.Bytes(), 0);
}

void ExpectDenseStep(const FactorGraph& graph) {
  const Layout layout(graph, true);
  ExpectDenseStep(graph, Eigen::VectorXd::Constant(layout.size(), 1e-3), kOneChunk);
  Eigen::VectorXd uneven(layout.size());
  for (int k = 0; k < layout.size(); ++k) {
    uneven[k] = 0.01 * (1 + k % 7);
  }
  for (const std::int64_t quads_per_chunk : {kOneChunk, std::int64_t{100}, std::int64_t{1}}) {
    ExpectDenseStep(graph, uneven, quads_per_chunk);
  }
}

class EliminationOfBundle : public testing::TestWithParam<unsigned> {
 protected:
  EliminationOfBundle() { options_.seed = GetParam(); }
  BundleOptions options_;
};

TEST_P(EliminationOfBundle, OneLandmarkSizeAtATime) {
  for (const int size : {1, 2, 3, 4}) {
    options_.landmark_sizes = {size};
    ExpectDenseStep(MakeBundle(options_)->graph());
  }
}

TEST_P(EliminationOfBundle, FramesWhoseBlocksHaveTheirLastColumnApart) {
  options_.landmark_sizes = {3, 1, 4, 2};
  options_.residual_sizes = {2, 3, 5};
  for (const int size : {5, 9, 13}) {
    options_.frame_sizes = {size};
    ExpectDenseStep(MakeBundle(options_)->graph());
  }
}

TEST_P(EliminationOfBundle, MixedSizes) {
  options_.num_frames = 8;
  options_.num_landmarks = 60;
  options_.frame_sizes = {6, 9, 15, 3, 1, 7};
  options_.landmark_sizes = {1, 2, 3, 4};
  options_.residual_sizes = {2, 3, 1, 4, 5, 17};
  ExpectDenseStep(MakeBundle(options_)->graph());
}

TEST_P(EliminationOfBundle, ManifoldsLossesConstantsAndHosts) {
  options_.num_frames = 12;
  options_.num_landmarks = 80;
  options_.landmark_sizes = {1, 3};
  options_.hosted = true;
  options_.manifolds = true;
  options_.losses = true;
  options_.constants = true;
  ExpectDenseStep(MakeBundle(options_)->graph());
}

INSTANTIATE_TEST_SUITE_P(Seeds, EliminationOfBundle, testing::Values(31u, 32u, 33u));

// Of more than 65,536 landmarks U_inv and z are those of one chunk, and found again: the same bits,
// for any number of threads, and once planning has forgotten what it needed.
TEST(Elimination, SameBitsWhereLandmarksAreForgotten) {
  for (const int size : {6, 9}) {
    BundleOptions options;
    options.num_frames = 9;
    options.num_landmarks = 66000;
    options.num_views = 2;
    options.frame_sizes = {size};
    options.landmark_sizes = {3, 1, 4, 2};
    const std::unique_ptr<RandomGraph> bundle = MakeBundle(options);
    const CorePipeline core(bundle->graph(), true);
    ASSERT_GT(core.incidences.num_chunks(), 1);
    std::vector<double> damping(static_cast<std::size_t>(core.layout.size()));
    for (std::size_t k = 0; k < damping.size(); ++k) {
      damping[k] = 0.01 * static_cast<double>(1 + k % 7);
    }
    const int n_c = core.layout.frame_size();
    const auto solve = [&](const CorePipeline& in, Elimination* elimination) {
      EXPECT_TRUE(elimination->Eliminate(damping.data() + n_c).ok());
      std::vector<double> result(elimination->b(), elimination->b() + n_c);
      result.insert(result.end(), elimination->S(),
                    elimination->S() + in.plans.pattern.value_begin.back());
      std::vector<double> step(damping.size() - static_cast<std::size_t>(n_c));
      elimination->BackSubstitute(elimination->b(), step.data());
      result.insert(result.end(), step.begin(), step.end());
      return result;
    };
    Elimination keeps(core.evaluator, core.incidences, core.plans, core.hessian);
    const std::vector<double> expected = solve(core, &keeps);
    for (const int num_threads : {1, 3}) {
      CorePipeline lean(bundle->graph(), true, num_threads);
      Elimination forgets(lean.evaluator, lean.incidences, lean.plans, lean.hessian,
                          {nullptr, /*may_forget_landmarks=*/true});
      EXPECT_LT(forgets.Bytes(), keeps.Bytes());
      lean.incidences.ForgetPlaces();
      EXPECT_TRUE(lean.incidences.factors.empty());
      EXPECT_EQ(solve(lean, &forgets), expected) << num_threads << " threads";
    }
  }
}

TEST(Elimination, LandmarksSeenInEveryUnusualWay) {
  RandomGraph random(41);
  const VariableId frame = random.AddFrame(6);
  const VariableId other = random.AddFrame(std::make_shared<PoseManifold>());
  const VariableId still = random.AddFrame(6);
  random.graph().SetConstant(still, true);
  const VariableId twice = random.AddLandmark(3);
  const VariableId unmoved = random.AddLandmark(3);
  const VariableId prior = random.AddLandmark(2);
  const VariableId single = random.AddLandmark(4);
  random.Connect(2, {frame, twice}, std::make_shared<CauchyLoss>(0.2));
  random.Connect(2, {frame, twice});
  random.Connect(3, {twice, frame});
  random.Connect(2, {still, unmoved});
  random.Connect(3, {prior});
  random.Connect(2, {frame, prior, other});
  random.Connect(5, {other, single});
  random.Connect(7, {frame, other});
  ExpectDenseStep(random.graph());
}

TEST(Elimination, EveryFrameConstant) {
  RandomGraph random(42);
  const VariableId still = random.AddFrame(6);
  random.graph().SetConstant(still, true);
  for (int l = 0; l < 5; ++l) {
    const VariableId landmark = random.AddLandmark(1 + l % 4);
    random.Connect(2, {still, landmark});
    random.Connect(3, {still, landmark});
  }
  ExpectDenseStep(random.graph());
}

// A landmark without information: singular without damping, harmless with it.
class SingularLandmarks : public testing::Test {
 protected:
  // Landmarks 1, 2, 3 of size 3; number 2 is seen once (rank 2), number 3 has Jacobian zero.
  SingularLandmarks() {
    random_.AddFrame(6);
    for (int l = 0; l < 3; ++l) {
      random_.AddLandmark(3);
    }
    random_.Connect(6, {0});
    for (int n = 0; n < 3; ++n) {
      random_.Connect(2, {0, 1});
    }
    random_.Connect(2, {0, 2});
    const auto blind = test::JetFamily<2, 6, 3>(
        [](const auto* x, const auto* /*landmark*/, auto* f) { std::copy_n(x, 2, f); });
    random_.graph().AddFactor(random_.graph().AddFamily(blind), 0, {0, 3});
  }
  RandomGraph random_{43};
};

TEST_F(SingularLandmarks, AreNamedByTheirVariableTheFirstOneFirst) {
  for (const int num_threads : {1, 4}) {
    const CorePipeline core(random_.graph(), true, num_threads);
    Elimination elimination(core.evaluator, core.incidences, core.plans, core.hessian);
    std::vector<double> damping(9, 0.0);
    for (int k = 3; k < 6; ++k) {
      damping[static_cast<std::size_t>(k)] = 1.0;  // landmark 2 is saved
    }
    const Status status = elimination.Eliminate(damping.data());
    EXPECT_EQ(status.code, StatusCode::kSingular);
    EXPECT_NE(status.message.find("landmark variable 3 "), std::string::npos) << status.message;
  }
}

TEST_F(SingularLandmarks, DampingMakesThemHarmless) {
  ExpectDenseStep(random_.graph());
}

TEST_F(SingularLandmarks, EliminationWorksAgainAfterAFailure) {
  const CorePipeline core(random_.graph());
  Elimination elimination(core.evaluator, core.incidences, core.plans, core.hessian);
  const std::vector<double> none(9, 0.0);
  const std::vector<double> some(9, 0.1);
  ASSERT_EQ(elimination.Eliminate(none.data()).code, StatusCode::kSingular);
  ASSERT_TRUE(elimination.Eliminate(some.data()).ok());
  Elimination fresh(core.evaluator, core.incidences, core.plans, core.hessian);
  ASSERT_TRUE(fresh.Eliminate(some.data()).ok());
  EXPECT_TRUE(
      std::equal(fresh.S(), fresh.S() + core.plans.pattern.value_begin.back(), elimination.S()));
  EXPECT_TRUE(std::equal(fresh.b(), fresh.b() + 6, elimination.b()));
}

TEST_F(SingularLandmarks, DampingThatIsNotFiniteIsSingularToo) {
  const CorePipeline core(random_.graph());
  Elimination elimination(core.evaluator, core.incidences, core.plans, core.hessian);
  std::vector<double> damping(9, 0.1);
  damping[0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(elimination.Eliminate(damping.data()).code, StatusCode::kSingular);
  damping[0] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(elimination.Eliminate(damping.data()).code, StatusCode::kSingular);
}

std::unique_ptr<RandomGraph> TwentyFrames(int num_landmarks) {
  BundleOptions options;
  options.num_frames = 20;
  options.num_landmarks = num_landmarks;
  options.landmark_sizes = {3, 1};
  return MakeBundle(options);
}

std::vector<double> LandmarkSteps(const CorePipeline& core, Elimination* elimination) {
  std::vector<double> step(static_cast<std::size_t>(core.layout.size()), 0.5);
  elimination->BackSubstitute(step.data(), step.data() + core.layout.frame_size());
  return step;
}

// Nothing of a chunk is left over for the next elimination, nor for the next way back.
TEST(Elimination, ChunksGiveTheSameAgain) {
  const auto bundle = TwentyFrames(300);
  const CorePipeline core(bundle->graph(), true, 1, 500);
  ASSERT_GT(core.incidences.num_chunks(), 5);
  const auto frame_size = static_cast<std::size_t>(core.layout.frame_size());
  const std::vector<double> damping(static_cast<std::size_t>(core.layout.size()), 0.01);
  Elimination elimination(core.evaluator, core.incidences, core.plans, core.hessian);
  ASSERT_TRUE(elimination.Eliminate(damping.data()).ok());
  const std::vector<double> first = LandmarkSteps(core, &elimination);
  EXPECT_EQ(first, LandmarkSteps(core, &elimination));
  const std::vector<double> b(elimination.b(), elimination.b() + frame_size);
  ASSERT_TRUE(elimination.Eliminate(damping.data()).ok());
  EXPECT_EQ(b, std::vector<double>(elimination.b(), elimination.b() + frame_size));
}

class EliminationByThreads : public testing::TestWithParam<std::int64_t> {};

TEST_P(EliminationByThreads, SameBitsForAnyNumberOfThreads) {
  const auto bundle = TwentyFrames(600);
  const CorePipeline one(bundle->graph(), true, 1, GetParam());
  const std::vector<double> damping(static_cast<std::size_t>(one.layout.size()), 0.01);
  Elimination expected(one.evaluator, one.incidences, one.plans, one.hessian);
  ASSERT_TRUE(expected.Eliminate(damping.data()).ok());
  const std::vector<double> expected_step = LandmarkSteps(one, &expected);
  for (const int num_threads : {2, 4}) {
    const CorePipeline many(bundle->graph(), true, num_threads, GetParam());
    Elimination actual(many.evaluator, many.incidences, many.plans, many.hessian);
    ASSERT_TRUE(actual.Eliminate(damping.data()).ok());
    EXPECT_TRUE(
        std::equal(expected.S(), expected.S() + one.plans.pattern.value_begin.back(), actual.S()));
    EXPECT_TRUE(std::equal(expected.b(), expected.b() + one.layout.frame_size(), actual.b()));
    EXPECT_EQ(LandmarkSteps(many, &actual), expected_step);
  }
}

INSTANTIATE_TEST_SUITE_P(Chunks, EliminationByThreads, testing::Values(kOneChunk, 1000));

}  // namespace
}  // namespace inceres::internal
