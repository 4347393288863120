// Jacobians by factor, in the order of landmarks whatever that of the factors is, in single
// precision and in chunks: what is summed from them is what Jacobians by slot give, of single ones
// to their rounding; the gradient to that of doubles.
#include <algorithm>
#include <iterator>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "linearize/jacobian_sums.h"
#include "linearize/variable_look_up.h"

namespace inceres::internal {
namespace {

constexpr JacobianStorage kByFactor = JacobianStorage::kByFactor;
constexpr JacobianStorage kInSingle = JacobianStorage::kByFactorInSingle;
constexpr JacobianStorage kInChunks = JacobianStorage::kInChunks;

class StoredJacobians : public ::testing::TestWithParam<std::tuple<JacobianStorage, Order>> {
 protected:
  const JacobianStorage storage_ = std::get<0>(GetParam());
  const std::unique_ptr<test::RandomGraph> bundle_ =
      BundleIn(std::get<1>(GetParam()), /*mixed=*/storage_ == kInChunks);
  const std::int64_t quads_per_chunk_ =
      storage_ == kInChunks ? 2000 : LandmarkIncidences::kQuadsPerChunk;
};

TEST_P(StoredJacobians, HaveTheSumsOfOthers) {
  const JacobianStorage other = storage_ == kByFactor   ? JacobianStorage::kBySlot
                                : storage_ == kInSingle ? kByFactor
                                                        : JacobianStorage::kWithoutPadding;
  constexpr std::int64_t kOneChunk = std::int64_t{1} << 40;
  for (const std::int64_t quads_per_chunk : {quads_per_chunk_, kOneChunk}) {
    const Sums expected(bundle_->graph(), other, 1, quads_per_chunk);
    const Sums actual(bundle_->graph(), storage_, 1, quads_per_chunk);
    if (storage_ == kInChunks) {
      EXPECT_NEAR(actual.core.cost, expected.core.cost, 1e-13 * expected.core.cost);
      EXPECT_EQ(actual.P, expected.P);
    } else {
      EXPECT_EQ(actual.core.cost, expected.core.cost) << "costs come from residuals";
    }
    EXPECT_LT(Distance(actual.gradient, expected.gradient), storage_ == kInSingle ? 1e-13 : 1e-12);
    ExpectLinearSums(actual, expected, storage_ == kInSingle ? 1e-6 : 1e-12);
    // On manifolds observations are of several families, which are too small for it.
    if (storage_ == kInSingle && std::get<1>(GetParam()) != Order::kManifolds) {
      EXPECT_GT(Distance(actual.product, expected.product), 1e-12) << "they are in single";
    }
  }
}

TEST_P(StoredJacobians, HaveTheSameBitsForAnyNumberOfThreads) {
  const Sums one(bundle_->graph(), storage_, 1, quads_per_chunk_);
  for (const int num_threads : {2, 4}) {
    const Sums many(bundle_->graph(), storage_, num_threads, quads_per_chunk_);
    ExpectTheBitsOfASolve(many, one);
    EXPECT_EQ(many.product, one.product);
    EXPECT_EQ(many.decrease, one.decrease);
  }
}

INSTANTIATE_TEST_SUITE_P(Bundles, StoredJacobians,
                         ::testing::Combine(::testing::Values(kByFactor, kInSingle, kInChunks),
                                            ::testing::Values(Order::kPlain, Order::kHosted,
                                                              Order::kByFrame, Order::kManifolds)));

class JacobiansByFactor : public ::testing::TestWithParam<Order> {};

// In the order of the factors all sums are those of padded rows, to the bit, but for what the model
// promises.
TEST_P(JacobiansByFactor, WithoutPaddingHaveTheBitsOfJacobiansBySlot) {
  const auto bundle = BundleIn(GetParam(), /*mixed=*/false);
  const Sums padded(bundle->graph(), JacobianStorage::kBySlot);
  const Sums packed(bundle->graph(), JacobianStorage::kWithoutPadding);
  ExpectTheBitsOfASolve(packed, padded);
  // Each factor's share is summed by code that the compiler contracts as it likes.
  EXPECT_LT(Distance(packed.decrease, padded.decrease), 1e-15);
  for (const Linearization& cache : packed.core.evaluator.families()) {
    EXPECT_TRUE(cache.records.empty());
  }
}

// Parameters and maps that are looked up chunk by chunk: the same passes in less memory, at the
// start, at a candidate, and there once it is accepted.
TEST_P(JacobiansByFactor, HaveTheSameBitsWithoutTables) {
  const auto bundle = BundleIn(GetParam(), /*mixed=*/false);
  for (const int num_threads : {1, 3}) {
    test::CorePipeline with(bundle->graph(), true, num_threads, LandmarkIncidences::kQuadsPerChunk,
                            JacobianStorage::kWithoutPadding);
    test::CorePipeline without(bundle->graph(), true, num_threads,
                               LandmarkIncidences::kQuadsPerChunk,
                               JacobianStorage::kWithoutPadding);
    VariableLookUp look_up;
    look_up.Bind(bundle->graph(), without.evaluator.points());
    int num_served = 0;
    for (Linearization& family : without.evaluator.families()) {
      look_up.Serve(&family);
      num_served += family.look_up != nullptr ? 1 : 0;
    }
    EXPECT_EQ(num_served, 1);
    EXPECT_LT(without.evaluator.Bytes(), with.evaluator.Bytes());
    const std::vector<double> step(static_cast<std::size_t>(with.layout.size()), 1e-3);
    std::vector<double> costs;
    for (Evaluator* const evaluator : {&with.evaluator, &without.evaluator}) {
      double cost = 0.0;
      EXPECT_TRUE(evaluator->points().MoveCandidate(step.data()));
      EXPECT_TRUE(evaluator->EvaluateCandidateCost(&cost).ok());
      costs.push_back(cost);
      evaluator->AcceptCandidate();
      EXPECT_TRUE(evaluator->EvaluateJacobians(/*known_point=*/true, &cost).ok());
      costs.push_back(cost);
    }
    EXPECT_EQ(costs[0], costs[2]);
    EXPECT_EQ(costs[1], costs[3]);
    for (std::size_t f = 0; f < with.evaluator.families().size(); ++f) {
      const Linearization& a = with.evaluator.families()[f];
      const Linearization& b = without.evaluator.families()[f];
      EXPECT_TRUE(a.residuals == b.residuals);
      EXPECT_TRUE(a.jacobian_values == b.jacobian_values);
      // Those at fault are told by their values.
      for (const bool candidate : {false, true}) {
        const std::vector<const double*> of_a = ParametersOf(a, a.num_factors - 1, candidate);
        const std::vector<const double*> of_b = ParametersOf(b, b.num_factors - 1, candidate);
        ASSERT_EQ(of_a.size(), of_b.size());
        for (std::size_t s = 0; s < of_a.size(); ++s) {
          EXPECT_EQ(*of_a[s], *of_b[s]);
        }
      }
    }
  }
}

// Each landmark's one after the other, in the order of its factors; those without one last.
TEST_P(JacobiansByFactor, LieInTheOrderOfLandmarks) {
  const auto bundle = BundleIn(GetParam(), /*mixed=*/false);
  const test::CorePipeline core(bundle->graph(), true, 1, LandmarkIncidences::kQuadsPerChunk,
                                JacobianStorage::kByFactor);
  int num_sorted = 0;
  for (const Linearization& cache : core.evaluator.families()) {
    num_sorted += cache.records.empty() ? 0 : 1;
    std::vector<std::tuple<int, int, int>> places;  // landmark, factor, record
    for (int i = 0; i < cache.num_factors; ++i) {
      const VariableId* ids = core.evaluator.graph().Variables(cache.id, i);
      const int landmark = core.layout.LandmarkOf(ids[cache.num_slots - 1]);
      places.emplace_back(landmark < 0 ? core.layout.num_landmarks() : landmark, i,
                          cache.Record(i));
    }
    std::sort(places.begin(), places.end());
    for (int k = 0; k < cache.num_factors && !cache.records.empty(); ++k) {
      ASSERT_EQ(std::get<2>(places[static_cast<std::size_t>(k)]), k);
    }
  }
  EXPECT_EQ(num_sorted, GetParam() == Order::kByFrame ? 1 : 0);
}

INSTANTIATE_TEST_SUITE_P(Bundles, JacobiansByFactor,
                         ::testing::Values(Order::kPlain, Order::kHosted, Order::kByFrame));

}  // namespace
}  // namespace inceres::internal
