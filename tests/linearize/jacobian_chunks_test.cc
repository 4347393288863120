// Jacobians of a chunk of landmarks at a time: each is, to the bit, the one that is kept otherwise,
// whatever was evaluated meanwhile, and what is summed from them is the same up to rounding.
#include "linearize/jacobian_chunks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>

#include "linearize/row_products.h"
#include "linearize/variable_look_up.h"
#include "schur/elimination.h"
#include "support/core_pipeline.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

enum class Order { kPlain, kHosted, kByFrame, kManifolds };

constexpr std::int64_t kSmallChunks = 2000;  // quads

std::unique_ptr<test::RandomGraph> BundleInChunks(Order kind) {
  test::BundleOptions bundle;
  bundle.seed = 1400;
  bundle.num_frames = 12;
  bundle.num_landmarks = 600;
  bundle.num_views = 5;
  bundle.frame_sizes = {kind == Order::kHosted ? 6 : 9};
  bundle.landmark_sizes = {3, 1};
  bundle.residual_sizes = {2, 3};
  bundle.hosted = kind == Order::kHosted;
  bundle.by_frame = kind == Order::kByFrame;
  bundle.manifolds = kind == Order::kManifolds;
  bundle.losses = bundle.constants = true;
  bundle.perturbation = 0.1;
  return test::MakeBundle(bundle);
}

// One of the two ways, with an elimination of its own.
struct Path {
  Path(const FactorGraph& graph, JacobianStorage storage, int num_threads = 1)
      : core(graph, /*eliminate_landmarks=*/true, num_threads, kSmallChunks, storage),
        elimination(core.evaluator, core.incidences, core.plans, core.hessian) {
    EXPECT_TRUE(core.status.ok()) << core.status.message;
    step.resize(static_cast<std::size_t>(core.layout.size()));
  }
  // The candidate is elsewhere, and was evaluated last.
  void GoAstray() {
    const std::vector<double> away(step.size(), 1e-2);
    double cost = 0.0;
    EXPECT_TRUE(core.evaluator.points().MoveCandidate(away.data()));
    EXPECT_TRUE(core.evaluator.EvaluateCandidateCost(&cost).ok());
  }
  // A step of frames that is as good as another, and what follows from it.
  void Solve() {
    const std::vector<double> damping(step.size(), 0.1);
    EXPECT_TRUE(elimination.Eliminate(damping.data()).ok());
    const int frame_size = core.layout.frame_size();
    std::copy_n(elimination.b(), frame_size, step.begin());
    JacobianChunks* const chunks = core.evaluator.jacobian_chunks();
    JacobianProduct product(core.evaluator);
    if (chunks == nullptr) {
      elimination.BackSubstitute(step.data(), step.data() + frame_size);
      products = product.Multiply(step.data());
      return;
    }
    for (int chunk = 0; chunk < chunks->num_chunks(); ++chunk) {
      EXPECT_TRUE(chunks->Bring(chunk).ok());
      if (chunk < core.incidences.num_chunks()) {
        elimination.BackSubstitute(core.incidences.chunk_begin[chunk],
                                   core.incidences.chunk_begin[chunk + 1], step.data(),
                                   step.data() + frame_size);
      }
      product.AddChunk(chunk, core.incidences, step.data(), &products);
    }
    const RowProducts again = product.Multiply(step.data());
    EXPECT_EQ(again.model_decrease, products.model_decrease);
    EXPECT_EQ(again.squared_norm, products.squared_norm);
  }
  std::vector<double> S() const {
    return {elimination.S(), elimination.S() + core.plans.pattern.value_begin.back()};
  }

  test::CorePipeline core;
  Elimination elimination;
  std::vector<double> step;
  RowProducts products;
};

double LengthOf(const std::vector<double>& v) {
  return std::sqrt(std::inner_product(v.begin(), v.end(), v.begin(), 0.0));
}

void ExpectClose(const std::vector<double>& actual, const std::vector<double>& expected) {
  ASSERT_EQ(actual.size(), expected.size());
  std::vector<double> difference(actual.size());
  std::transform(actual.begin(), actual.end(), expected.begin(), difference.begin(),
                 std::minus<>());
  EXPECT_LE(LengthOf(difference), 1e-12 * LengthOf(expected));
}

class Chunks : public ::testing::TestWithParam<Order> {};

TEST_P(Chunks, HaveTheBitsOfJacobiansThatAreKept) {
  const auto bundle = BundleInChunks(GetParam());
  Path kept(bundle->graph(), JacobianStorage::kWithoutPadding);
  Path anew(bundle->graph(), JacobianStorage::kInChunks, 3);
  anew.GoAstray();
  JacobianChunks& chunks = *anew.core.evaluator.jacobian_chunks();
  ASSERT_GT(chunks.num_chunks(), 5);
  std::vector<int> num_met(kept.core.evaluator.families().size(), 0);
  for (int chunk = chunks.num_chunks() - 1; chunk >= 0; --chunk) {
    ASSERT_TRUE(chunks.Bring(chunk).ok());
    for (const Linearization& cache : anew.core.evaluator.families()) {
      const Linearization& expected = kept.core.evaluator.families()[cache.id];
      for (int i = 0; i < cache.num_factors; ++i) {
        const int record = cache.Record(i);
        if (record < chunks.Begin(chunk, cache.id) || record >= chunks.End(chunk, cache.id)) {
          continue;
        }
        ++num_met[cache.id];
        EXPECT_TRUE(std::equal(cache.residuals.data() + record * cache.residual_size,
                               cache.residuals.data() + (record + 1) * cache.residual_size,
                               expected.residuals.data() + i * cache.residual_size));
        for (int s = 0; s < cache.num_slots; ++s) {
          if (cache.tangent_offsets[static_cast<std::size_t>(cache.Entry(i) + s)] < 0) {
            continue;  // nobody writes, or reads, a block without a place
          }
          const double* const J = cache.slots[s].data + record * cache.slots[s].factor_stride;
          ASSERT_TRUE(std::equal(J, J + cache.residual_size * cache.slots[s].row_stride,
                                 expected.slots[s].data + i * expected.slots[s].factor_stride));
        }
      }
    }
  }
  for (const Linearization& cache : kept.core.evaluator.families()) {
    EXPECT_EQ(num_met[cache.id], cache.num_factors);
  }
}

TEST_P(Chunks, HaveTheSumsOfJacobiansThatAreKept) {
  const auto bundle = BundleInChunks(GetParam());
  Path kept(bundle->graph(), JacobianStorage::kWithoutPadding);
  Path anew(bundle->graph(), JacobianStorage::kInChunks);
  EXPECT_NEAR(anew.core.cost, kept.core.cost, 1e-13 * kept.core.cost);
  ExpectClose(test::FrameHessian(anew.core), test::FrameHessian(kept.core));
  ExpectClose(anew.core.hessian.gradient(), kept.core.hessian.gradient());
  ExpectClose(anew.core.hessian.diagonal(), kept.core.hessian.diagonal());
  for (int l = 0; l < kept.core.layout.num_landmarks(); ++l) {
    std::array<double, kQuad*kQuad> expected = {}, P = {};
    kept.core.hessian.GetP(l, expected.data());
    anew.core.hessian.GetP(l, P.data());
    EXPECT_EQ(P, expected);
  }
  kept.Solve();
  anew.GoAstray();
  anew.Solve();
  ExpectClose(anew.S(), kept.S());
  ExpectClose(anew.step, kept.step);
  EXPECT_NEAR(anew.products.model_decrease, kept.products.model_decrease,
              1e-11 * std::fabs(kept.products.squared_norm));
  EXPECT_NEAR(anew.products.squared_norm, kept.products.squared_norm,
              1e-11 * kept.products.squared_norm);
}

TEST_P(Chunks, HaveTheSameBitsForAnyNumberOfThreadsAndWithoutTables) {
  const auto bundle = BundleInChunks(GetParam());
  Path one(bundle->graph(), JacobianStorage::kInChunks);
  one.Solve();
  for (const int num_threads : {2, 4}) {
    Path many(bundle->graph(), JacobianStorage::kInChunks, num_threads);
    many.Solve();
    EXPECT_EQ(many.core.cost, one.core.cost);
    EXPECT_EQ(many.core.hessian.gradient(), one.core.hessian.gradient());
    EXPECT_EQ(many.core.hessian.diagonal(), one.core.hessian.diagonal());
    EXPECT_EQ(test::FrameHessian(many.core), test::FrameHessian(one.core));
    EXPECT_EQ(many.S(), one.S());
    EXPECT_EQ(many.step, one.step);
    EXPECT_EQ(many.products.model_decrease, one.products.model_decrease);
  }
}

// A large graph of which only factors, or only landmarks, are there.
TEST(ChunksOfOneKind, CoverAllFactors) {
  for (const bool eliminates : {false, true}) {
    const auto bundle = BundleInChunks(Order::kByFrame);
    FactorGraph& graph = bundle->graph();
    for (VariableId id = 0; eliminates && id < graph.num_variables(); ++id) {
      if (graph.role(id) == Role::kFrame) {
        graph.SetConstant(id, true);
      }
    }
    const test::CorePipeline kept(graph, eliminates);
    const test::CorePipeline anew(graph, eliminates, 2, kSmallChunks, JacobianStorage::kInChunks);
    ASSERT_TRUE(anew.status.ok());
    ExpectClose(anew.hessian.gradient(), kept.hessian.gradient());
    ExpectClose(anew.hessian.diagonal(), kept.hessian.diagonal());
    const RowProducts expected = MultiplyJacobian(kept.evaluator, kept.hessian.gradient().data());
    const RowProducts actual = MultiplyJacobian(anew.evaluator, kept.hessian.gradient().data());
    EXPECT_NEAR(actual.squared_norm, expected.squared_norm, 1e-12 * expected.squared_norm);
    if (eliminates) {
      EXPECT_GT(anew.incidences.num_chunks(), 1) << "Jacobians count, though Y is empty";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Bundles, Chunks,
                         ::testing::Values(Order::kPlain, Order::kHosted, Order::kByFrame,
                                           Order::kManifolds));

}  // namespace
}  // namespace inceres::internal
