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
    const double step = 0.1;
    system_.step().SetFrame(0, &step);
    double change = 0.0;
    double predicted = 0.0;
    EXPECT_TRUE(system_.step().Evaluate(&change, &predicted).ok());
    system_.AcceptValues();
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

}  // namespace
}  // namespace inceres::internal
