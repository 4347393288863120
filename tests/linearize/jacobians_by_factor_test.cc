// Jacobians by factor, in the order of landmarks whatever that of the factors is, and in single
// precision: what is summed from them is what Jacobians by slot give, of single ones to their
// rounding; the gradient to that of doubles.
#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <memory>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "linearize/row_products.h"
#include "linearize/variable_look_up.h"
#include "schur/elimination.h"
#include "support/core_pipeline.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

// Observations are one family of 12,000 or more factors, which takes six strips; between frames,
// and priors, there are few.
enum class Kind { kPlain, kHosted, kByFrame };

std::unique_ptr<test::RandomGraph> Bundle(Kind kind) {
  const bool hosted = kind == Kind::kHosted;
  test::BundleOptions bundle;
  bundle.num_frames = 12;
  bundle.num_landmarks = 3000;
  bundle.num_views = hosted ? 5 : 4;
  bundle.frame_sizes = {hosted ? 6 : 9};
  bundle.hosted = hosted;
  bundle.by_frame = kind == Kind::kByFrame;
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
      double lower[kQuad * kQuad] = {};
      core.hessian.GetP(l, lower);
      P.insert(P.end(), lower, lower + kQuad * kQuad);
    }
    b.assign(elimination.b(), elimination.b() + layout.frame_size());
    S.assign(elimination.S(), elimination.S() + core.plans.pattern.value_begin.back());
    std::vector<double> v(static_cast<std::size_t>(layout.quad_offset[layout.num_frames]) * kQuad);
    for (std::size_t k = 0; k < v.size(); ++k) {
      v[k] = std::sin(static_cast<double>(k));
    }
    product.resize(v.size());
    elimination.SubtractReduced(v.data(), product.data());
    TakeRightHandSideOfRows(damping);
    step.resize(static_cast<std::size_t>(layout.size() - layout.frame_size()));
    elimination.BackSubstitute(b.data(), step.data());
    const RowProducts products = MultiplyJacobian(core.evaluator, gradient.data());
    decrease = {products.model_decrease, products.squared_norm};
  }

  // b where no block of S is formed: of several chunks it comes from the Jacobians.
  void TakeRightHandSideOfRows(const std::vector<double>& damping) {
    const FramePlans plans(core.evaluator, core.incidences, SchurBlocks::kNone);
    Hessian hessian(core.evaluator, core.incidences, plans);
    hessian.Accumulate();
    Elimination without_S(core.evaluator, core.incidences, plans, hessian);
    EXPECT_TRUE(without_S.Eliminate(damping.data()).ok());
    b_of_rows.assign(without_S.b(), without_S.b() + core.layout.frame_size());
  }

  test::CorePipeline core;
  Elimination elimination;
  std::vector<double> gradient, C, P, b, b_of_rows, S, product, step, decrease;
};

// All that is made of Jacobians, but for the gradient.
void ExpectLinearSums(const Sums& actual, const Sums& expected, double tolerance) {
  EXPECT_LT(Distance(actual.C, expected.C), tolerance);
  EXPECT_LT(Distance(actual.P, expected.P), tolerance);
  EXPECT_LT(Distance(actual.S, expected.S), tolerance);
  EXPECT_LT(Distance(actual.b, expected.b), tolerance);
  EXPECT_LT(Distance(actual.b_of_rows, expected.b), tolerance);
  EXPECT_LT(Distance(actual.product, expected.product), tolerance);
  EXPECT_LT(Distance(actual.step, expected.step), tolerance);
  EXPECT_LT(Distance(actual.decrease, expected.decrease), tolerance);
}

// All that a solve takes its step from.
void ExpectTheBitsOfASolve(const Sums& actual, const Sums& expected) {
  EXPECT_EQ(actual.core.cost, expected.core.cost);
  EXPECT_EQ(actual.gradient, expected.gradient);
  EXPECT_EQ(actual.C, expected.C);
  EXPECT_EQ(actual.P, expected.P);
  EXPECT_EQ(actual.S, expected.S);
  EXPECT_EQ(actual.b, expected.b);
  EXPECT_EQ(actual.step, expected.step);
}

class JacobiansByFactor : public ::testing::TestWithParam<Kind> {};

TEST_P(JacobiansByFactor, InSingleHaveTheSumsOfDoublesToTheirRounding) {
  const auto bundle = Bundle(GetParam());
  constexpr std::int64_t kOneChunk = std::int64_t{1} << 40;
  for (const std::int64_t quads_per_chunk : {LandmarkIncidences::kQuadsPerChunk, kOneChunk}) {
    const Sums in_double(bundle->graph(), JacobianStorage::kByFactor, 1, quads_per_chunk);
    const Sums in_single(bundle->graph(), JacobianStorage::kByFactorInSingle, 1, quads_per_chunk);
    EXPECT_EQ(in_single.core.cost, in_double.core.cost) << "costs come from residuals";
    EXPECT_LT(Distance(in_single.gradient, in_double.gradient), 1e-13);
    ExpectLinearSums(in_single, in_double, 1e-6);
    EXPECT_GT(Distance(in_single.product, in_double.product), 1e-12) << "they are in single";
  }
}

TEST_P(JacobiansByFactor, HaveTheSumsOfJacobiansBySlot) {
  const auto bundle = Bundle(GetParam());
  const Sums by_slot(bundle->graph(), JacobianStorage::kBySlot);
  const Sums by_factor(bundle->graph(), JacobianStorage::kByFactor);
  EXPECT_EQ(by_factor.core.cost, by_slot.core.cost);
  EXPECT_LT(Distance(by_factor.gradient, by_slot.gradient), 1e-12);
  ExpectLinearSums(by_factor, by_slot, 1e-12);
}

// In the order of the factors all sums are those of padded rows, to the bit, but for what the model
// promises.
TEST_P(JacobiansByFactor, WithoutPaddingHaveTheBitsOfJacobiansBySlot) {
  const auto bundle = Bundle(GetParam());
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
  const auto bundle = Bundle(GetParam());
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
  const auto bundle = Bundle(GetParam());
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
  EXPECT_EQ(num_sorted, GetParam() == Kind::kByFrame ? 1 : 0);
}

TEST_P(JacobiansByFactor, HaveTheSameBitsForAnyNumberOfThreads) {
  const auto bundle = Bundle(GetParam());
  for (const JacobianStorage storage :
       {JacobianStorage::kByFactor, JacobianStorage::kByFactorInSingle}) {
    const Sums one(bundle->graph(), storage);
    for (const int num_threads : {2, 4}) {
      const Sums many(bundle->graph(), storage, num_threads);
      ExpectTheBitsOfASolve(many, one);
      EXPECT_EQ(many.product, one.product);
      EXPECT_EQ(many.decrease, one.decrease);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Bundles, JacobiansByFactor,
                         ::testing::Values(Kind::kPlain, Kind::kHosted, Kind::kByFrame));

}  // namespace
}  // namespace inceres::internal
