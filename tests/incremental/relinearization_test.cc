// Which old linearizations convergence may not rest on: those that err too much for the tolerance
// there is when it is claimed, whatever it was when they were last moved.

#include "incremental/relinearization.h"

#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "incremental/whole_graph.h"
#include "support/test_families.h"

namespace inceres::internal {
namespace {

// By 0.1: residuals follow, Jacobians do not.
void MoveFirstFrame(IncrementalSystem* system) {
  const double step = 0.1;
  system->step().SetFrame(0, &step);
  double change = 0.0;
  double predicted = 0.0;
  EXPECT_TRUE(system->step().Evaluate(&change, &predicted).ok());
  system->AcceptValues();
}

// One factor f = x² at x = 1, linearized, and moved by 0.1 since: its linearization errs by 0.01.
class MovedSquare {
 public:
  MovedSquare()
      : family_(graph_.AddFamily(
            test::ScalarFamily([](double x) { return x * x; }, [](double x) { return 2.0 * x; }))),
        system_(graph_, 1),
        relinearization_(Tuning().relinearize, &system_) {
    const double start = 1.0;
    const VariableId x = graph_.AddVariable(&start, 1, Role::kFrame);
    graph_.AddFactor(family_, 0, {x});
    AddWholeGraph(&system_);
    relinearization_.Begin(IncrementalOptions(), /*share=*/0.1);
    Renew();
    MoveFirstFrame(&system_);
  }

  void Renew() {
    RelinearizeWork work;
    EXPECT_TRUE(system_.Relinearize(0.0, RebuildPolicy::kNever, &work).ok());
  }
  bool IsDirty() const { return system_.IsDirty({family_.id, 0}); }
  Relinearization& relinearization() { return relinearization_; }

 private:
  FactorGraph graph_;
  FamilyHandle<test::FunctionFamily> family_;
  IncrementalSystem system_;
  Relinearization relinearization_;
};

constexpr double kLarge = 1e3;
constexpr double kSmall = 1e-9;

TEST(Relinearization, WhatALargeToleranceLetPassIsRenewedBeforeASmallOne) {
  MovedSquare square;
  square.relinearization().MarkStale(kLarge);
  EXPECT_FALSE(square.IsDirty());
  EXPECT_FALSE(square.relinearization().RefreshAged(kLarge));
  EXPECT_TRUE(square.relinearization().RefreshAged(kSmall));
  EXPECT_TRUE(square.IsDirty());
}

TEST(Relinearization, AToleranceThatFallsALittleAtATimeIsFollowed) {
  MovedSquare square;
  square.relinearization().MarkStale(kLarge);
  double tolerance = kLarge;
  while (!square.relinearization().RefreshAged(tolerance)) {
    tolerance *= 0.7;
    ASSERT_GT(tolerance, kSmall);
  }
  EXPECT_TRUE(square.IsDirty());
  EXPECT_FALSE(square.relinearization().RefreshAged(tolerance / 0.7));
}

TEST(Relinearization, WhatWasRenewedIsGoodEnough) {
  MovedSquare square;
  square.relinearization().MarkStale(kLarge);
  EXPECT_TRUE(square.relinearization().RefreshAged(kSmall));
  square.Renew();
  EXPECT_FALSE(square.relinearization().RefreshAged(kSmall));
}

// A factor of a frame, which has moved since it was linearized, and of another variable, of which
// the second coordinate has a pivot of stiffness² by itself, about.
bool IsRenewedAnyway(Role role, double stiffness) {
  FactorGraph graph;
  const auto family =
      graph.AddFamily(test::JetFamily<3, 1, 2>([=](const auto* x, const auto* l, auto* f) {
        f[0] = x[0] * x[0];
        f[1] = l[0] + l[1];
        f[2] = stiffness * l[1];
      }));
  const double start[2] = {1.0, 1.0};
  const VariableId frame = graph.AddVariable(start, 1, Role::kFrame);
  graph.AddFactor(family, 0, {frame, graph.AddVariable(start, 2, role)});
  IncrementalSystem system(graph, 1);
  AddWholeGraph(&system);
  RelinearizeWork work;
  EXPECT_TRUE(
      system.Relinearize(Tuning().landmarks.min_damping, RebuildPolicy::kNever, &work).ok());
  MoveFirstFrame(&system);
  constexpr double kTolerance = 0.1;  // enough for others
  Relinearization relinearization(Tuning().relinearize, &system);
  relinearization.Begin(IncrementalOptions(), /*share=*/0.1);
  return relinearization.RefreshAged(kTolerance) && system.IsDirty({family.id, 0});
}

TEST(Relinearization, WhereADirectionIsWeakOldJacobiansClaimNothing) {
  for (const Role role : {Role::kFrame, Role::kLandmark}) {
    EXPECT_FALSE(IsRenewedAnyway(role, 1.0));
    EXPECT_FALSE(IsRenewedAnyway(role, 0.1));
    EXPECT_TRUE(IsRenewedAnyway(role, 0.02));
    EXPECT_TRUE(IsRenewedAnyway(role, 1e-4));
    EXPECT_TRUE(IsRenewedAnyway(role, 0.0));
  }
}

}  // namespace
}  // namespace inceres::internal
