#include "linearize/evaluator.h"

#include <malloc.h>

#include <gtest/gtest.h>

#include "inceres/problem/manifolds.h"
#include "support/core_pipeline.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::BundleOptions;
using test::CorePipeline;
using test::MakeBundle;
using test::RandomGraph;

BundleOptions CurvedBundle() {
  BundleOptions options;
  options.num_frames = 9;
  options.manifolds = true;
  options.losses = true;
  options.constants = true;
  return options;
}

TEST(Evaluator, MovesEveryVariableOnItsManifoldAndNoConstant) {
  const auto bundle = MakeBundle(CurvedBundle());
  const FactorGraph& graph = bundle->graph();
  CorePipeline core(graph);
  const std::vector<double> delta =
      bundle->random().Vector(static_cast<std::size_t>(core.layout.size()));
  ASSERT_TRUE(core.evaluator.points().MoveCandidate(delta.data()));
  EXPECT_EQ(core.evaluator.points().current(), graph.state());
  std::vector<double> expected = graph.state();
  for (std::size_t i = 0; i < core.layout.variables.size(); ++i) {
    const VariableId id = core.layout.variables[i];
    double* x = expected.data() + graph.StateOffset(id);
    const double* step = delta.data() + core.layout.packed_offset[i];
    if (graph.manifold(id) != nullptr) {
      ASSERT_TRUE(graph.manifold(id)->Plus(x, step, x));
      continue;
    }
    for (int k = 0; k < graph.AmbientSize(id); ++k) {
      x[k] += step[k];
    }
  }
  EXPECT_EQ(core.evaluator.points().candidate(), expected);
}

// The candidate's cost, then its Jacobians after acceptance, are those of a graph that starts
// there.
TEST(Evaluator, AnAcceptedCandidateIsLikeAFreshStart) {
  const auto bundle = MakeBundle(CurvedBundle());
  CorePipeline core(bundle->graph());
  std::vector<double> delta = bundle->random().Vector(static_cast<std::size_t>(core.layout.size()));
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(core.evaluator.points().MoveCandidate(delta.data()));
    double candidate_cost = 0.0;
    ASSERT_TRUE(core.evaluator.EvaluateCandidateCost(&candidate_cost).ok());
    EXPECT_NEAR(candidate_cost, test::CostAt(bundle->graph(), core.evaluator.points().candidate()),
                1e-12 * candidate_cost);
    core.evaluator.AcceptCandidate();
    double cost = 0.0;
    ASSERT_TRUE(core.evaluator.EvaluateJacobians(/*known_point=*/true, &cost).ok());
    EXPECT_EQ(cost, candidate_cost);
    core.hessian.Accumulate();

    bundle->graph().mutable_state() = core.evaluator.points().current();
    CorePipeline fresh(bundle->graph());
    EXPECT_EQ(fresh.cost, cost);
    EXPECT_EQ(fresh.hessian.C(), core.hessian.C());
    EXPECT_EQ(fresh.hessian.gradient(), core.hessian.gradient());
  }
}

// A rejected candidate leaves no trace: the linearization point's Jacobians come out the same.
TEST(Evaluator, ARejectedCandidateLeavesNoTrace) {
  const auto bundle = MakeBundle(CurvedBundle());
  CorePipeline core(bundle->graph());
  const std::vector<double> gradient = core.hessian.gradient();
  const std::vector<double> delta =
      bundle->random().Vector(static_cast<std::size_t>(core.layout.size()));
  ASSERT_TRUE(core.evaluator.points().MoveCandidate(delta.data()));
  double cost = 0.0;
  ASSERT_TRUE(core.evaluator.EvaluateCandidateCost(&cost).ok());
  ASSERT_TRUE(core.evaluator.EvaluateJacobians(/*known_point=*/true, &cost).ok());
  core.hessian.Accumulate();
  EXPECT_EQ(core.hessian.gradient(), gradient);
  EXPECT_EQ(cost, core.cost);
}

// A manifold whose map changes its kind from one point to the next: the classification is done anew
// every time.
TEST(Evaluator, TangentMapsAreClassifiedAtEveryPoint) {
  class Switching final : public Manifold {
   public:
    int AmbientSize() const override { return 2; }
    int TangentSize() const override { return 2; }
    bool Plus(const double* x, const double* delta, double* out) const override {
      out[0] = x[0] + delta[0];
      out[1] = x[1] + delta[1];
      return true;
    }
    bool PlusJacobian(const double* x, double* J) const override {
      const double identity[4] = {1.0, 0.0, 0.0, 1.0};
      const double swapped[4] = {0.0, 1.0, 1.0, 0.0};
      const double dense[4] = {1.0, 0.5, 0.25, 2.0};
      std::copy_n(x[0] < 1.0 ? identity : x[0] < 2.0 ? swapped : dense, 4, J);
      return true;
    }
  };
  RandomGraph random(4);
  const VariableId x = random.AddFrame(std::make_shared<Switching>());
  random.Connect(3, {x});
  CorePipeline core(random.graph());
  const double values[3][2] = {{0.5, 0.1}, {1.5, 0.2}, {2.5, 0.3}};
  for (const auto& value : values) {
    const double delta[2] = {value[0] - core.evaluator.points().current()[0],
                             value[1] - core.evaluator.points().current()[1]};
    double cost = 0.0;
    ASSERT_TRUE(core.evaluator.points().MoveCandidate(delta));
    ASSERT_TRUE(core.evaluator.EvaluateCandidateCost(&cost).ok());
    core.evaluator.AcceptCandidate();
    ASSERT_TRUE(core.evaluator.EvaluateJacobians(true, &cost).ok());
    core.hessian.Accumulate();
    random.graph().mutable_state() = core.evaluator.points().current();
    const test::DenseOracle oracle(random.graph(), {x});
    EXPECT_LT(
        test::RelativeError(test::ToDense(core.plans.pattern, core.hessian.C().data()), oracle.H),
        1e-12);
  }
}

// Memory that comes with anything in it: padding, and blocks of constants, are zero all the same.
TEST(Evaluator, WhatNoEvaluationWritesIsZero) {
  const auto bundle = MakeBundle(CurvedBundle());
#ifdef M_PERTURB
  mallopt(M_PERTURB, 0x5a);
#endif
  const CorePipeline core(bundle->graph());
#ifdef M_PERTURB
  mallopt(M_PERTURB, 0);
#endif
  for (const Linearization& family : core.evaluator.families()) {
    for (int s = 0; s < family.num_slots; ++s) {
      const SlotJacobians& slot = family.slots[s];
      for (int i = 0; i < family.num_factors; ++i) {
        const bool written = family.tangent_offsets[family.Entry(i) + s] >= 0;
        for (int k = 0; k < slot.factor_stride; ++k) {
          if (!written || k % slot.row_stride >= slot.columns) {
            EXPECT_EQ(slot.data[i * slot.factor_stride + k], 0.0);
          }
        }
      }
    }
  }
}

TEST(Evaluator, BytesCountTheJacobians) {
  RandomGraph random(4);
  random.Connect(2, {random.AddFrame(6), random.AddLandmark(3)});
  const CorePipeline core(random.graph());
  EXPECT_GE(core.evaluator.Bytes(), static_cast<std::int64_t>(sizeof(double) * (2 * 8 + 2 * 4)));
}

}  // namespace
}  // namespace inceres::internal
