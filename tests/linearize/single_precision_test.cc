// Jacobians in single precision: what is summed from them is what doubles give, to their rounding;
// the gradient to that of doubles.
#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "linearize/row_products.h"
#include "schur/elimination.h"
#include "support/core_pipeline.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

// Observations are one family of 12,000 or more factors, which takes six strips; between frames,
// and priors, there are few.
std::unique_ptr<test::RandomGraph> Bundle(bool hosted) {
  test::BundleOptions bundle;
  bundle.num_frames = 12;
  bundle.num_landmarks = 3000;
  bundle.num_views = hosted ? 5 : 4;
  bundle.frame_sizes = {hosted ? 6 : 9};
  bundle.hosted = hosted;
  bundle.losses = bundle.constants = true;
  bundle.perturbation = 0.1;
  return test::MakeBundle(bundle);
}

double Norm(const std::vector<double>& v) {
  double square = 0.0;
  for (const double entry : v) {
    square += entry * entry;
  }
  return std::sqrt(square);
}

// ‖a − b‖ / ‖b‖.
double Distance(const std::vector<double>& a, const std::vector<double>& b) {
  EXPECT_EQ(a.size(), b.size());
  std::vector<double> difference;
  std::transform(a.begin(), a.end(), b.begin(), std::back_inserter(difference), std::minus<>());
  return Norm(difference) / Norm(b);
}

// All that a solve sums from Jacobians.
struct Sums {
  Sums(const FactorGraph& graph, JacobianStorage storage, int num_threads = 1,
       std::int64_t quads_per_chunk = LandmarkIncidences::kQuadsPerChunk)
      : core(graph, /*eliminate_landmarks=*/true, num_threads, quads_per_chunk, storage),
        elimination(core.evaluator, core.incidences, core.plans, core.hessian) {
    EXPECT_TRUE(core.status.ok()) << core.status.message;
    const Layout& layout = core.layout;
    const std::vector<double> damping(static_cast<std::size_t>(layout.size()), 0.1);
    EXPECT_TRUE(elimination.Eliminate(damping.data()).ok());
    gradient = core.hessian.gradient();
    C = test::FrameHessian(core);
    for (int l = 0; l < layout.num_landmarks(); ++l) {
      P.insert(P.end(), core.hessian.P(l), core.hessian.P(l) + core.hessian.landmark_stride());
    }
    b.assign(elimination.b(), elimination.b() + layout.frame_size());
    S.assign(elimination.S(), elimination.S() + core.plans.pattern.value_begin.back());
    std::vector<double> v(static_cast<std::size_t>(layout.quad_offset[layout.num_frames]) * kQuad);
    for (std::size_t k = 0; k < v.size(); ++k) {
      v[k] = std::sin(static_cast<double>(k));
    }
    coupled.resize(v.size());
    elimination.AddCoupled(v.data(), coupled.data());
    step.resize(static_cast<std::size_t>(layout.size() - layout.frame_size()));
    elimination.BackSubstitute(b.data(), step.data());
    const RowProducts products = MultiplyJacobian(core.evaluator, gradient.data());
    decrease = {products.model_decrease, products.squared_norm};
  }

  test::CorePipeline core;
  Elimination elimination;
  std::vector<double> gradient, C, P, b, S, coupled, step, decrease;
};

// All that is made of Jacobians, but for the gradient.
void ExpectLinearSums(const Sums& actual, const Sums& expected, double tolerance) {
  EXPECT_LT(Distance(actual.C, expected.C), tolerance);
  EXPECT_LT(Distance(actual.P, expected.P), tolerance);
  EXPECT_LT(Distance(actual.S, expected.S), tolerance);
  EXPECT_LT(Distance(actual.b, expected.b), tolerance);
  EXPECT_LT(Distance(actual.coupled, expected.coupled), tolerance);
  EXPECT_LT(Distance(actual.step, expected.step), tolerance);
  EXPECT_LT(Distance(actual.decrease, expected.decrease), tolerance);
}

class SinglePrecision : public ::testing::TestWithParam<bool> {};

TEST_P(SinglePrecision, SumsAreThoseOfDoublesToTheRoundingOfAJacobian) {
  const auto bundle = Bundle(GetParam());
  constexpr std::int64_t kOneChunk = std::int64_t{1} << 40;
  for (const std::int64_t quads_per_chunk : {LandmarkIncidences::kQuadsPerChunk, kOneChunk}) {
    const Sums in_double(bundle->graph(), JacobianStorage::kByFactor, 1, quads_per_chunk);
    const Sums in_single(bundle->graph(), JacobianStorage::kByFactorInSingle, 1, quads_per_chunk);
    EXPECT_EQ(in_single.core.cost, in_double.core.cost) << "costs come from residuals";
    EXPECT_LT(Distance(in_single.gradient, in_double.gradient), 1e-13);
    ExpectLinearSums(in_single, in_double, 1e-6);
    EXPECT_GT(Distance(in_single.coupled, in_double.coupled), 1e-12) << "they are in single";
  }
}

TEST_P(SinglePrecision, SumsOfJacobiansByFactorAreThoseOfJacobiansBySlot) {
  const auto bundle = Bundle(GetParam());
  const Sums by_slot(bundle->graph(), JacobianStorage::kBySlot);
  const Sums by_factor(bundle->graph(), JacobianStorage::kByFactor);
  EXPECT_EQ(by_factor.core.cost, by_slot.core.cost);
  EXPECT_LT(Distance(by_factor.gradient, by_slot.gradient), 1e-12);
  ExpectLinearSums(by_factor, by_slot, 1e-12);
}

TEST_P(SinglePrecision, SumsHaveTheSameBitsForAnyNumberOfThreads) {
  const auto bundle = Bundle(GetParam());
  const Sums one(bundle->graph(), JacobianStorage::kByFactorInSingle);
  for (const int num_threads : {2, 4}) {
    const Sums many(bundle->graph(), JacobianStorage::kByFactorInSingle, num_threads);
    EXPECT_EQ(many.core.cost, one.core.cost);
    EXPECT_EQ(many.gradient, one.gradient);
    EXPECT_EQ(many.C, one.C);
    EXPECT_EQ(many.P, one.P);
    EXPECT_EQ(many.S, one.S);
    EXPECT_EQ(many.b, one.b);
    EXPECT_EQ(many.coupled, one.coupled);
    EXPECT_EQ(many.step, one.step);
    EXPECT_EQ(many.decrease, one.decrease);
  }
}

INSTANTIATE_TEST_SUITE_P(Bundles, SinglePrecision, ::testing::Bool(),
                         [](const auto& hosted) { return hosted.param ? "hosted" : "plain"; });

}  // namespace
}  // namespace inceres::internal
