// Jacobians of a chunk of landmarks at a time: each is, to the bit, the one that is kept otherwise,
// whatever was evaluated meanwhile. Of what is summed from them see jacobian_storage_test.cc.
#include "linearize/jacobian_chunks.h"

#include <algorithm>
#include <vector>

#include <gtest/gtest.h>

#include "linearize/jacobian_sums.h"

namespace inceres::internal {
namespace {

constexpr std::int64_t kSmallChunks = 2000;  // quads

class Chunks : public ::testing::TestWithParam<Order> {};

TEST_P(Chunks, HaveTheBitsOfJacobiansThatAreKept) {
  const auto bundle = BundleIn(GetParam(), /*mixed=*/true);
  const Sums kept(bundle->graph(), JacobianStorage::kWithoutPadding);
  Sums anew(bundle->graph(), JacobianStorage::kInChunks, 3, kSmallChunks);
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

INSTANTIATE_TEST_SUITE_P(Bundles, Chunks,
                         ::testing::Values(Order::kPlain, Order::kHosted, Order::kByFrame,
                                           Order::kManifolds));

// A large graph of which only factors, or only landmarks, are there.
TEST(ChunksOfOneKind, CoverAllFactors) {
  for (const bool eliminates : {false, true}) {
    const auto bundle = BundleIn(Order::kByFrame, /*mixed=*/true);
    FactorGraph& graph = bundle->graph();
    for (VariableId id = 0; eliminates && id < graph.num_variables(); ++id) {
      if (graph.role(id) == Role::kFrame) {
        graph.SetConstant(id, true);
      }
    }
    const test::CorePipeline kept(graph, eliminates);
    const test::CorePipeline anew(graph, eliminates, 2, kSmallChunks, JacobianStorage::kInChunks);
    ASSERT_TRUE(anew.status.ok());
    EXPECT_LE(Distance(anew.hessian.gradient(), kept.hessian.gradient()), 1e-12);
    EXPECT_LE(Distance(anew.hessian.diagonal(), kept.hessian.diagonal()), 1e-12);
    const RowProducts expected = MultiplyJacobian(kept.evaluator, kept.hessian.gradient().data());
    const RowProducts actual = MultiplyJacobian(anew.evaluator, kept.hessian.gradient().data());
    EXPECT_NEAR(actual.squared_norm, expected.squared_norm, 1e-12 * expected.squared_norm);
    if (eliminates) {
      EXPECT_GT(anew.incidences.num_chunks(), 1) << "Jacobians count, though Y is empty";
    }
  }
}

}  // namespace
}  // namespace inceres::internal
