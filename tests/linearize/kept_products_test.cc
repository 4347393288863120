#include "linearize/kept_products.h"

#include <gtest/gtest.h>

#include "inceres/solver/marginalization.h"
#include "support/core_pipeline.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::CorePipeline;

// Three frames with a frozen prior of 18 rows on all of them, a tall factor with curvature, and
// short ones.
class KeptProductsOfWindow : public testing::Test {
 protected:
  KeptProductsOfWindow() {
    std::vector<VariableId> frames;
    LinearPrior shape;
    for (int i = 0; i < 3; ++i) {
      frames.push_back(random_.AddFrame(6));
      shape.blocks.push_back({random_.random().Vector(6), nullptr, 6});
    }
    shape.J = random_.random().Vector(18 * 18);
    shape.e0 = random_.random().Vector(18);
    prior_family_ = graph().AddFamily(std::make_shared<LinearPriorFamily>(shape));
    graph().AddFactor(prior_family_, shape, frames);
    random_.Connect(20, {frames[0], frames[1]});
    random_.Connect(2, {frames[1], frames[2]});
  }

  FactorGraph& graph() { return random_.graph(); }

  // The pipeline moved on to another point and evaluated there.
  void MoveOn(CorePipeline* core) {
    const std::vector<double> delta =
        random_.random().Vector(static_cast<std::size_t>(core->layout.size()));
    ASSERT_TRUE(core->evaluator.points().MoveCandidate(delta.data()));
    ASSERT_TRUE(core->evaluator.EvaluateCandidateCost(&core->cost).ok());
    core->evaluator.AcceptCandidate();
    ASSERT_TRUE(core->evaluator.EvaluateJacobians(true, &core->cost).ok());
  }

  test::RandomGraph random_{5};
  FamilyHandle<LinearPriorFamily> prior_family_;
};

TEST_F(KeptProductsOfWindow, OnlyAFrozenJacobianIsKept) {
  CorePipeline core(graph());
  KeptProducts kept(core.evaluator, core.plans);
  const FamilyId curved = prior_family_ + 1;
  kept.Observe();
  EXPECT_TRUE(kept.IsStale(prior_family_));
  EXPECT_TRUE(kept.IsStale(curved));
  kept.Observe();
  EXPECT_FALSE(kept.IsStale(prior_family_));
  EXPECT_FALSE(kept.IsStale(curved));
  MoveOn(&core);
  kept.Observe();
  EXPECT_FALSE(kept.IsStale(prior_family_));
  EXPECT_TRUE(kept.IsStale(curved));
}

TEST_F(KeptProductsOfWindow, ShortFactorsTakeNoPart) {
  CorePipeline core(graph());
  KeptProducts kept(core.evaluator, core.plans);
  int num_kept = 0;
  for (std::size_t s = 0; s < core.plans.hessian.segments.size(); ++s) {
    const int family = core.plans.hessian_sources[core.plans.hessian.segments[s].source].family;
    EXPECT_EQ(kept.Find(static_cast<int>(s)) != nullptr, family <= prior_family_ + 1);
    num_kept += kept.Find(static_cast<int>(s)) != nullptr ? 1 : 0;
  }
  EXPECT_EQ(num_kept, 6 + 3);
}

TEST_F(KeptProductsOfWindow, TheHessianHasTheBitsOfOneThatKeptNothing) {
  CorePipeline core(graph());
  for (int iteration = 0; iteration < 3; ++iteration) {
    MoveOn(&core);
    core.hessian.Accumulate();
    Hessian fresh(core.evaluator, core.incidences, core.plans);
    fresh.Accumulate();
    EXPECT_EQ(core.hessian.C(), fresh.C());
    EXPECT_EQ(core.hessian.gradient(), fresh.gradient());
  }
}

}  // namespace
}  // namespace inceres::internal
