// Linearizations that are kept while their variables move: what they predict, the curvature that a
// loss leaves them, and landmarks whose coordinates have units of their own.

#include "incremental/incremental_system.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "incremental/cached_rows.h"
#include "incremental/whole_graph.h"
#include "schur/batch_system.h"
#include "support/random_graph.h"
#include "support/test_families.h"

namespace inceres::internal {
namespace {

using test::RandomGraph;

// What the old linearization predicts, f̂, is exact for a step no factor curves under: the error it
// is kept for is then zero.
TEST(IncrementalSystem, TheErrorOfALinearizationIsThatOfItsPrediction) {
  RandomGraph graph(3);
  const VariableId frame = graph.AddFrame(3);
  graph.Connect(4, {frame}, std::make_shared<HuberLoss>(0.1));
  IncrementalSystem system(graph.graph(), 1);
  AddWholeGraph(&system);
  RelinearizeWork work;
  ASSERT_TRUE(system.Relinearize(0.0, RebuildPolicy::kNever, &work).ok());
  const IncrementalFamily& family = system.families()[0];
  EXPECT_EQ(family.weighed().SquaredError(0), 0.0);
  double errors[2] = {0.0, 0.0};
  for (const int halvings : {0, 1}) {
    const double size = halvings == 0 ? 1e-2 : 5e-3;
    const double step[3] = {size, -size, size};
    system.step().SetFrame(0, step);
    double change = 0.0;
    double predicted = 0.0;
    ASSERT_TRUE(system.step().Evaluate(&change, &predicted).ok());
    system.Accept();
    errors[halvings] = std::sqrt(family.weighed().SquaredError(0));
    system.MarkDirty({0, 0});
    ASSERT_TRUE(system.Relinearize(0.0, RebuildPolicy::kNever, &work).ok());
  }
  EXPECT_NEAR(errors[0] / errors[1], 4.0, 0.5) << "the error is of second order in the step";
}

// f = x, far out in the linear part of a Huber loss: its second derivative is ρ' across f, and
// nothing along it.
class Outlier {
 public:
  Outlier() {
    const auto family = test::JetFamily<2, 2>([](const auto* x, auto* f) { std::copy_n(x, 2, f); });
    const double start[2] = {3.0, 4.0};
    const VariableId frame = graph_.AddVariable(start, 2, Role::kFrame);
    graph_.AddFactor(graph_.AddFamily(family), 0, {frame}, std::make_shared<HuberLoss>(0.1));
    system_ = std::make_unique<IncrementalSystem>(graph_, 1);
    AddWholeGraph(system_.get());
    Relinearize();
  }

  void Relinearize() {
    system_->MarkDirty({0, 0});
    RelinearizeWork work;
    ASSERT_TRUE(system_->Relinearize(0.0, RebuildPolicy::kNever, &work).ok());
  }

  void Move(double dx, double dy) {
    const double step[2] = {dx, dy};
    system_->step().SetFrame(0, step);
    double change = 0.0;
    double predicted = 0.0;
    ASSERT_TRUE(system_->step().Evaluate(&change, &predicted).ok());
    system_->Accept();
  }

  void Put(double x, double y) {
    const double values[2] = {x, y};
    system_->SetValues(0, values);
  }

  // Jᵀq is the gradient ρ' f.
  void ExpectGradient() const {
    const double* x = system_->variables().current(0);
    const double w = 0.1 / std::hypot(x[0], x[1]);
    const double* J = family().Jacobian(0, 0);
    for (int k = 0; k < 2; ++k) {
      EXPECT_NEAR(J[k] * family().weighed().q(0)[0] + J[kQuad + k] * family().weighed().q(0)[1],
                  w * x[k], 1e-15);
      EXPECT_NEAR(system_->schur().b(0)[k], -w * x[k], 1e-15);
    }
  }

  // ‖J d‖² over that of √ρ' times the plain Jacobian, d of length 1.
  double Curvature(double x, double y) const {
    const double* J = family().Jacobian(0, 0);
    const double w =
        0.1 / std::hypot(system_->variables().current(0)[0], system_->variables().current(0)[1]);
    return (std::pow(J[0] * x + J[1] * y, 2) + std::pow(J[kQuad] * x + J[kQuad + 1] * y, 2)) / w;
  }

  const IncrementalFamily& family() const { return system_->families()[0]; }
  const IncrementalSystem& system() const { return *system_; }

 private:
  FactorGraph graph_;
  std::unique_ptr<IncrementalSystem> system_;
};

TEST(CorrectedLinearization, HasLessCurvatureAlongTheResidualAndTheSameGradient) {
  Outlier outlier;
  EXPECT_FALSE(outlier.family().weighed().IsCorrected(0)) << "nothing has moved yet";
  EXPECT_NEAR(outlier.Curvature(0.6, 0.8), 1.0, 1e-14);
  outlier.Move(0.03, 0.04);
  outlier.Relinearize();
  EXPECT_TRUE(outlier.family().weighed().IsCorrected(0));
  EXPECT_NEAR(outlier.Curvature(0.6, 0.8), 0.5, 1e-14);
  EXPECT_NEAR(outlier.Curvature(-0.8, 0.6), 1.0, 1e-14);
  outlier.ExpectGradient();
}

TEST(CorrectedLinearization, KeepsTheGradientAndPredictsResidualsWhileItIsKept) {
  Outlier outlier;
  outlier.Move(0.03, 0.04);
  outlier.Relinearize();
  outlier.Move(-0.2, 0.5);
  EXPECT_TRUE(outlier.family().weighed().IsCorrected(0));
  outlier.ExpectGradient();
  EXPECT_NEAR(outlier.family().weighed().SquaredError(0), 0.0, 1e-28) << "the factor is linear";
}

TEST(CorrectedLinearization, IsTheSameWhenItIsMadeAgain) {
  Outlier outlier;
  outlier.Move(0.9, 1.2);
  for (int time = 0; time < 2; ++time) {
    outlier.Relinearize();
    EXPECT_TRUE(outlier.family().weighed().IsCorrected(0));
    EXPECT_NEAR(outlier.Curvature(0.6, 0.8), 0.5, 1e-14);
  }
}

TEST(CorrectedLinearization, IsNotThatOfAFactorPutElsewhere) {
  Outlier outlier;
  outlier.Move(0.03, 0.04);
  outlier.Put(-30.0, 50.0);
  outlier.Relinearize();
  EXPECT_FALSE(outlier.family().weighed().IsCorrected(0));
}

TEST(CorrectedLinearization, IsTakenBackWhereRowsAreAskedFor) {
  Outlier outlier;
  outlier.Move(0.03, 0.04);
  outlier.Relinearize();
  outlier.Move(-0.02, 0.05);
  ASSERT_TRUE(outlier.family().weighed().IsCorrected(0));
  CachedRows rows(outlier.system(), 1.0);
  LinearizedFactor factor;
  ASSERT_TRUE(rows.Find(
      {0, 0}, [](VariableId) { return true; }, &factor));
  const double* x = outlier.system().variables().current(0);
  const double sqrt_w = std::sqrt(0.1 / std::hypot(x[0], x[1]));
  for (int r = 0; r < 2; ++r) {
    EXPECT_NEAR(factor.f[r], sqrt_w * x[r], 1e-14);
    for (int c = 0; c < 2; ++c) {
      EXPECT_NEAR(factor.slots[0].data[r * factor.slots[0].row_stride + c], r == c ? sqrt_w : 0.0,
                  1e-14);
    }
  }
}

TEST(CorrectedLinearization, IsNotThatOfAFactorWhoseResidualChangesMuch) {
  Outlier outlier;
  outlier.Move(0.03, 0.04);
  outlier.Relinearize();
  outlier.Move(-1.8, -2.4);
  outlier.Relinearize();
  EXPECT_FALSE(outlier.family().weighed().IsCorrected(0));
  EXPECT_NEAR(outlier.Curvature(0.6, 0.8), 1.0, 1e-14);
  outlier.ExpectGradient();
}

// A landmark's coordinates have units of their own: a strong prior on one of them leaves the others
// their information.
TEST(IncrementalSystem, AStrongPriorOnOneCoordinateDoesNotParkALandmark) {
  FactorGraph graph;
  const auto views = test::JetFamily<2, 2, 1>([](const auto* l, const auto* x, auto* f) {
    f[0] = l[0] + x[0];
    f[1] = l[1] + x[0];
  });
  const auto pins = test::JetFamily<1, 2>([](const auto* l, auto* f) { f[0] = 1e7 * l[0]; });
  const double zero[2] = {0.0, 0.0};
  const VariableId landmark = graph.AddVariable(zero, 2, Role::kLandmark);
  const VariableId frame = graph.AddVariable(zero, 1, Role::kFrame);
  graph.AddFactor(graph.AddFamily(views), 0, {landmark, frame});
  graph.AddFactor(graph.AddFamily(pins), 0, {landmark});
  IncrementalSystem system(graph, 1);
  AddWholeGraph(&system);
  RelinearizeWork work;
  ASSERT_TRUE(system.Relinearize(1e-4, RebuildPolicy::kNever, &work).ok());
  EXPECT_EQ(system.schur().blocks().num_undetermined(), 0);
  BatchSystem(graph, system).ExpectLaw();
}

}  // namespace
}  // namespace inceres::internal
