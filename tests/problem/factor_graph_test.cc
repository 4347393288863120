#include "inceres/problem/factor_graph.h"

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "problem/blank_family.h"

namespace inceres {
namespace {

constexpr double kValues[9] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0};

TEST(FactorGraph, VariablesLieOneAfterTheOtherInTheState) {
  FactorGraph graph;
  EXPECT_EQ(graph.AddVariable(kValues, 3, Role::kLandmark), 0);
  EXPECT_EQ(graph.AddBorrowedConstant(kValues + 5, 2), 1);
  EXPECT_EQ(graph.AddVariable(kValues + 3, 4, Role::kFrame,
                              std::make_shared<RotationQuaternionManifold>()),
            2);
  EXPECT_EQ(graph.num_variables(), 3);
  EXPECT_EQ(graph.state(), (std::vector<double>{1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0}));
  EXPECT_EQ(graph.StateOffset(0), 0);
  EXPECT_EQ(graph.StateOffset(1), -1);
  EXPECT_EQ(graph.StateOffset(2), 3);
  EXPECT_EQ(graph.AmbientSize(2), 4);
  EXPECT_EQ(graph.TangentSize(2), 3);
  EXPECT_EQ(graph.TangentSize(0), 3);
  EXPECT_EQ(graph.role(0), Role::kLandmark);
  EXPECT_EQ(graph.manifold(0), nullptr);
  EXPECT_NE(graph.manifold(2), nullptr);
  EXPECT_TRUE(graph.Validate().ok());
}

TEST(FactorGraph, ValuesAreReadFromAnyStateAndBorrowedOnesInPlace) {
  FactorGraph graph;
  double borrowed[2] = {10.0, 11.0};
  const VariableId constant = graph.AddBorrowedConstant(borrowed, 2);
  graph.AddVariable(kValues, 1, Role::kFrame);
  const VariableId x = graph.AddVariable(kValues + 1, 2, Role::kFrame);
  EXPECT_EQ(graph.Values(x)[1], 3.0);
  const std::vector<double> candidate = {-1.0, -2.0, -3.0};
  EXPECT_EQ(graph.ValuesIn(candidate.data(), x), candidate.data() + 1);
  EXPECT_EQ(graph.ValuesIn(candidate.data(), constant), borrowed);
  borrowed[1] = 12.0;
  EXPECT_EQ(graph.Values(constant)[1], 12.0);
}

TEST(FactorGraph, SetValuesLeavesBorrowedValuesAlone) {
  FactorGraph graph;
  const double borrowed[2] = {10.0, 11.0};
  const VariableId constant = graph.AddBorrowedConstant(borrowed, 2);
  const VariableId x = graph.AddVariable(kValues, 2, Role::kFrame);
  graph.SetValues(x, kValues + 4);
  graph.SetValues(constant, kValues);
  EXPECT_EQ(graph.state(), (std::vector<double>{5.0, 6.0}));
  EXPECT_EQ(borrowed[0], 10.0);
}

TEST(FactorGraph, WhatIsConstant) {
  FactorGraph graph;
  const VariableId x = graph.AddVariable(kValues, 2, Role::kFrame);
  const VariableId borrowed = graph.AddBorrowedConstant(kValues, 2);
  const VariableId no_freedom = graph.AddVariable(
      kValues, 2, Role::kFrame, std::make_shared<SubsetManifold>(2, std::vector<int>{0, 1}));
  EXPECT_FALSE(graph.IsConstant(x));
  EXPECT_TRUE(graph.IsConstant(borrowed));
  EXPECT_TRUE(graph.IsConstant(no_freedom));
  graph.SetConstant(x, true);
  graph.SetConstant(borrowed, false);
  EXPECT_TRUE(graph.IsConstant(x));
  EXPECT_TRUE(graph.IsConstant(borrowed));
  graph.SetConstant(x, false);
  EXPECT_FALSE(graph.IsConstant(x));
}

TEST(FactorGraph, RolesMayChange) {
  FactorGraph graph;
  const VariableId x = graph.AddVariable(kValues, 2, Role::kFrame);
  graph.SetRole(x, Role::kLandmark);
  EXPECT_EQ(graph.role(x), Role::kLandmark);
}

TEST(FactorGraph, ConnectsFactorsInOrder) {
  FactorGraph graph;
  for (int k = 0; k < 4; ++k) {
    graph.AddVariable(kValues + k, 1, Role::kFrame);
  }
  const auto pairs = graph.AddFamily(
      std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{1, 1}, {1, 1}}));
  const auto singles =
      graph.AddFamily(std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{1, 1}}));
  EXPECT_EQ(graph.AddFactor(pairs, {}, {0, 1}), 0);
  EXPECT_EQ(graph.AddFactor(singles, {}, {2}), 0);
  EXPECT_EQ(graph.AddFactor(pairs, {}, {3, 2}), 1);
  EXPECT_EQ(graph.num_families(), 2);
  EXPECT_EQ(graph.num_factors(), 3);
  EXPECT_EQ(graph.NumFactors(pairs), 2);
  EXPECT_EQ(graph.Variables(pairs, 1)[0], 3);
  EXPECT_EQ(graph.Variables(pairs, 1)[1], 2);
  EXPECT_EQ(graph.Variables(singles, 0)[0], 2);
  EXPECT_EQ(&graph.family(singles), singles.family.get());
  EXPECT_TRUE(graph.Validate().ok());
}

// The list of losses appears with the first loss; factors before and after it without one have
// none.
TEST(FactorGraph, LossesBelongToTheirFactors) {
  FactorGraph graph;
  graph.AddVariable(kValues, 1, Role::kFrame);
  const auto family =
      graph.AddFamily(std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{1, 1}}));
  const auto huber = std::make_shared<HuberLoss>(1.0);
  graph.AddFactor(family, {}, {0});
  graph.AddFactor(family, {}, {0});
  EXPECT_FALSE(graph.HasLosses(family));
  EXPECT_EQ(graph.loss(family, 1), nullptr);
  graph.AddFactor(family, {}, {0}, huber);
  graph.AddFactor(family, {}, {0});
  EXPECT_TRUE(graph.HasLosses(family));
  EXPECT_EQ(graph.loss(family, 0), nullptr);
  EXPECT_EQ(graph.loss(family, 1), nullptr);
  EXPECT_EQ(graph.loss(family, 2), huber.get());
  EXPECT_EQ(graph.loss(family, 3), nullptr);
}

TEST(FactorGraph, ConnectManyIsConnectOneAfterTheOther) {
  const auto huber = std::make_shared<HuberLoss>(1.0);
  const std::vector<VariableId> variables = {0, 1, 1, 2, 2, 0};
  const std::vector<std::shared_ptr<const Loss>> losses = {nullptr, huber, nullptr};
  for (const bool with_losses : {false, true}) {
    for (const bool tracked : {false, true}) {
      FactorGraph many;
      FactorGraph single;
      for (FactorGraph* graph : {&many, &single}) {
        for (int k = 0; k < 3; ++k) {
          graph->AddVariable(kValues + k, 1, Role::kFrame);
        }
        graph->AddFamily(
            std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{1, 1}, {1, 1}}, 6));
        if (tracked) {
          graph->TrackFactors();
        }
      }
      for (int time = 0; time < 2; ++time) {  // to none, then to some
        many.ConnectMany(0, variables,
                         with_losses ? losses : std::vector<std::shared_ptr<const Loss>>());
        for (std::size_t i = 0; i < 3; ++i) {
          single.Connect(0, variables.data() + 2 * i, with_losses ? losses[i] : nullptr);
        }
        ASSERT_EQ(many.NumFactors(0), single.NumFactors(0));
        ASSERT_EQ(many.HasLosses(0), single.HasLosses(0));
        for (int i = 0; i < many.NumFactors(0); ++i) {
          EXPECT_EQ(many.Variables(0, i)[0], single.Variables(0, i)[0]);
          EXPECT_EQ(many.Variables(0, i)[1], single.Variables(0, i)[1]);
          EXPECT_EQ(many.loss(0, i), single.loss(0, i));
        }
        int num_touches = 0;
        many.TrackFactors();
        many.ForEachFactorOf(1, [&](FactorId) { ++num_touches; });
        EXPECT_EQ(num_touches, 2 * (time + 1));
      }
      EXPECT_TRUE(many.Validate().ok());
      EXPECT_GT(many.revision(), 0);
    }
  }
}

TEST(FactorGraph, ReserveChangesNothingButCapacity) {
  FactorGraph graph;
  graph.Reserve(10, 100);
  EXPECT_EQ(graph.num_variables(), 0);
  EXPECT_TRUE(graph.state().empty());
  const double* before = graph.state().data();
  for (int k = 0; k < 10; ++k) {
    graph.AddVariable(kValues, 9, Role::kFrame);
  }
  EXPECT_EQ(graph.state().data(), before);
}

TEST(FactorGraph, DescribesAFactor) {
  FactorGraph graph;
  const auto family = graph.AddFamily(
      std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{1, 1}, {1, 1}}));
  graph.AddFactor(family, {}, {0, 1});
  graph.AddFactor(family, {}, {3, 112});
  EXPECT_EQ(graph.DescribeFactor(family, 1), "factor 1 of blank (variables 3, 112)");
}

}  // namespace
}  // namespace inceres
