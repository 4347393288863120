#pragma once

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "linearize/jacobian_chunks.h"
#include "linearize/row_products.h"
#include "schur/elimination.h"
#include "support/core_pipeline.h"
#include "support/random_graph.h"

namespace inceres::internal {

enum class Order { kPlain, kHosted, kByFrame, kManifolds };

// `mixed`: several families of observations, of landmarks of several sizes. Otherwise they are one
// of 12,000 or more factors, which takes six strips; between frames, and priors, there are few.
inline std::unique_ptr<test::RandomGraph> BundleIn(Order order, bool mixed) {
  const bool hosted = order == Order::kHosted;
  test::BundleOptions bundle;
  bundle.num_frames = 12;
  bundle.num_landmarks = mixed ? 600 : 3000;
  bundle.num_views = hosted || mixed ? 5 : 4;
  bundle.frame_sizes = {hosted ? 6 : 9};
  if (mixed) {
    bundle.landmark_sizes = {3, 1};
    bundle.residual_sizes = {2, 3};
  }
  bundle.hosted = hosted;
  bundle.by_frame = order == Order::kByFrame;
  bundle.manifolds = order == Order::kManifolds;
  bundle.losses = bundle.constants = true;
  bundle.perturbation = 0.1;
  return test::MakeBundle(bundle);
}

inline double Norm(const std::vector<double>& v) {
  double square = 0.0;
  for (const double entry : v) {
    square += entry * entry;
  }
  return std::sqrt(square);
}

// ‖a − b‖ / ‖b‖.
inline double Distance(const std::vector<double>& a, const std::vector<double>& b) {
  EXPECT_EQ(a.size(), b.size());
  std::vector<double> difference;
  std::transform(a.begin(), a.end(), b.begin(), std::back_inserter(difference), std::minus<>());
  return Norm(difference) / Norm(b);
}

// All that a solve sums from Jacobians, for a step of frames that is as good as another. The
// candidate is elsewhere, and was evaluated last.
struct Sums {
  Sums(const FactorGraph& graph, JacobianStorage storage, int num_threads = 1,
       std::int64_t quads_per_chunk = LandmarkIncidences::kQuadsPerChunk)
      : core(graph, /*eliminate_landmarks=*/true, num_threads, quads_per_chunk, storage),
        elimination(core.evaluator, core.incidences, core.plans, core.hessian) {
    EXPECT_TRUE(core.status.ok()) << core.status.message;
    const Layout& layout = core.layout;
    gradient = core.hessian.gradient();
    diagonal = core.hessian.diagonal();
    C = test::FrameHessian(core);
    for (int l = 0; l < layout.num_landmarks(); ++l) {
      double lower[kQuad * kQuad] = {};
      core.hessian.GetP(l, lower);
      P.insert(P.end(), lower, lower + kQuad * kQuad);
    }
    GoAstray();
    const std::vector<double> damping(static_cast<std::size_t>(layout.size()), 0.1);
    EXPECT_TRUE(elimination.Eliminate(damping.data()).ok());
    b.assign(elimination.b(), elimination.b() + layout.frame_size());
    S.assign(elimination.S(), elimination.S() + core.plans.pattern.value_begin.back());
    step = b;
    step.resize(static_cast<std::size_t>(layout.size()));
    if (storage == JacobianStorage::kInChunks) {
      TakeStepInChunks();
      return;
    }
    elimination.BackSubstitute(step.data(), step.data() + layout.frame_size());
    const RowProducts products = MultiplyJacobian(core.evaluator, step.data());
    decrease = {products.model_decrease, products.squared_norm};
    TakeProduct();
    TakeRightHandSideOfRows(damping);
  }

  void GoAstray() {
    const std::vector<double> away(static_cast<std::size_t>(core.layout.size()), 1e-2);
    double cost = 0.0;
    EXPECT_TRUE(core.evaluator.points().MoveCandidate(away.data()));
    EXPECT_TRUE(core.evaluator.EvaluateCandidateCost(&cost).ok());
  }

  void TakeStepInChunks() {
    JacobianChunks& chunks = *core.evaluator.jacobian_chunks();
    JacobianProduct rows(core.evaluator);
    RowProducts products;
    for (int chunk = 0; chunk < chunks.num_chunks(); ++chunk) {
      EXPECT_TRUE(chunks.Bring(chunk).ok());
      if (chunk < core.incidences.num_chunks()) {
        elimination.BackSubstitute(core.incidences.chunk_begin[chunk],
                                   core.incidences.chunk_begin[chunk + 1], step.data(),
                                   step.data() + core.layout.frame_size());
      }
      rows.AddChunk(chunk, core.incidences, step.data(), &products);
    }
    decrease = {products.model_decrease, products.squared_norm};
    const RowProducts again = rows.Multiply(step.data());
    EXPECT_EQ(again.model_decrease, products.model_decrease);
    EXPECT_EQ(again.squared_norm, products.squared_norm);
  }

  // With S, by the Jacobians.
  void TakeProduct() {
    const Layout& layout = core.layout;
    std::vector<double> v(static_cast<std::size_t>(layout.quad_offset[layout.num_frames]) * kQuad);
    for (std::size_t k = 0; k < v.size(); ++k) {
      v[k] = std::sin(static_cast<double>(k));
    }
    product.resize(v.size());
    elimination.SubtractReduced(v.data(), product.data());
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
  std::vector<double> gradient, diagonal, C, P, b, S, step, decrease;
  std::vector<double> product, b_of_rows;  // of Jacobians that are kept
};

// All that is made of Jacobians, but for the gradient.
inline void ExpectLinearSums(const Sums& actual, const Sums& expected, double tolerance) {
  EXPECT_LT(Distance(actual.diagonal, expected.diagonal), tolerance);
  EXPECT_LT(Distance(actual.C, expected.C), tolerance);
  EXPECT_LT(Distance(actual.P, expected.P), tolerance);
  EXPECT_LT(Distance(actual.S, expected.S), tolerance);
  EXPECT_LT(Distance(actual.b, expected.b), tolerance);
  EXPECT_LT(Distance(actual.step, expected.step), tolerance);
  EXPECT_LT(Distance(actual.decrease, expected.decrease), tolerance);
  if (actual.core.evaluator.jacobian_chunks() == nullptr) {
    EXPECT_LT(Distance(actual.b_of_rows, expected.b), tolerance);
    EXPECT_LT(Distance(actual.product, expected.product), tolerance);
  }
}

// All that a solve takes its step from.
inline void ExpectTheBitsOfASolve(const Sums& actual, const Sums& expected) {
  EXPECT_EQ(actual.core.cost, expected.core.cost);
  EXPECT_EQ(actual.gradient, expected.gradient);
  EXPECT_EQ(actual.diagonal, expected.diagonal);
  EXPECT_EQ(actual.C, expected.C);
  EXPECT_EQ(actual.P, expected.P);
  EXPECT_EQ(actual.S, expected.S);
  EXPECT_EQ(actual.b, expected.b);
  EXPECT_EQ(actual.step, expected.step);
}

}  // namespace inceres::internal
