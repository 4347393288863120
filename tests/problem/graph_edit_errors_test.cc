// Every edit that cannot be carried out is refused as a whole: the id at fault is named and nothing
// has changed. What would be wrong in a graph that is built, too, is in graph_faults_test.cc.
#include <cmath>
#include <limits>
#include <utility>

#include <gtest/gtest.h>

#include "inceres/problem/manifolds.h"
#include "problem/graph_to_break.h"

namespace inceres {
namespace {

class EditErrors : public testing::Test {
 protected:
  // Besides what GraphToBreak has, variable 5 (a landmark) and factor 3 of the views have been
  // removed.
  EditErrors() {
    graph_.AddVariable(kValues, 3, Role::kLandmark);
    graph_.AddFactor(views_, {}, {0, 5});
    GraphEdit edit(graph_);
    edit.RemoveVariable(5);
    EXPECT_TRUE(graph_.Apply(edit).ok());
    edit_.Restart();
  }

  // Edits are begun anew for the next fault.
  void ExpectRefused(const std::string& expected) {
    inceres::ExpectRefused(&graph_, edit_, expected);
    edit_.Restart();
  }

  GraphToBreak to_break_;
  FactorGraph& graph_ = to_break_.graph;
  const FamilyHandle<BlankFamily>& views_ = to_break_.views;
  const FamilyHandle<BlankFamily>& pairs_ = to_break_.pairs;
  const double* const kValues = GraphToBreak::kValues;
  GraphEdit edit_{graph_};
};

TEST_F(EditErrors, AnotherGraph) {
  const FactorGraph other = graph_;
  inceres::ExpectRefused(&graph_, GraphEdit(other), "the edit was begun on another graph");
}

// The place alone does not name a factor: another one may have it by now.
TEST_F(EditErrors, AnIdWhosePlaceHasBeenGivenToAnotherFactor) {
  FactorId first;
  FactorId second;
  for (FactorId* id : {&first, &second}) {
    edit_.RemoveFactor({views_, 0});
    ASSERT_TRUE(graph_.Apply(edit_).ok());
    edit_.Restart();
    *id = edit_.AddFactor(views_, {}, {0, 1});
    ASSERT_TRUE(graph_.Apply(edit_).ok());
    edit_.Restart();
  }
  EXPECT_EQ(first.index, second.index);
  EXPECT_EQ(first.generation + 1, second.generation);
  const char* const expected = " has been removed, and its place given to another one";
  edit_.RemoveFactor(first);
  ExpectRefused("RemoveFactor: factor 0 of family 0 (blank)" + std::string(expected));
  edit_.SetLoss(first, nullptr);
  ExpectRefused(expected);
  edit_.MeasurementChanged(first);
  ExpectRefused(expected);
  edit_.RemoveFactor(second);
  EXPECT_TRUE(graph_.Apply(edit_).ok());
  edit_.Restart();
  edit_.RemoveFactor(second);
  ExpectInvalid(graph_.Apply(edit_), " has been removed");
}

TEST_F(EditErrors, StaleAfterAnyChangeOfStructure) {
  const GraphEdit stale(graph_);
  const std::int64_t revision = graph_.revision();
  const auto expect_stale = [&] {
    const GraphEdit now(graph_);
    EXPECT_EQ(now.revision(), graph_.revision());
    inceres::ExpectRefused(&graph_, stale,
                           "the edit was begun at revision " + std::to_string(revision) +
                               " of the graph, which is now at revision " +
                               std::to_string(graph_.revision()));
  };
  graph_.AddVariable(kValues, 2, Role::kFrame);
  expect_stale();
  graph_.AddBorrowedConstant(kValues, 2);
  expect_stale();
  graph_.AddFamily(pairs_.family);
  expect_stale();
  EXPECT_EQ(graph_.revision(), revision + 3);
  const GraphEdit empty(graph_);
  EXPECT_TRUE(graph_.Apply(empty).ok());
  EXPECT_EQ(graph_.revision(), revision + 4);
  expect_stale();
  inceres::ExpectRefused(&graph_, empty, "the edit was begun at revision");  // applied twice
}

// Ids were given out in view of another graph, which may have had the same revision.
TEST_F(EditErrors, StaleAfterAnAssignment) {
  const auto expect_stale = [this](const GraphEdit& edit) {
    const GraphEdit now(graph_);
    EXPECT_NE(now.revision(), edit.revision());
    inceres::ExpectRefused(&graph_, edit, "the edit was begun at revision");
  };
  FactorGraph other = graph_;
  EXPECT_EQ(other.revision(), graph_.revision());
  const GraphEdit first(graph_);
  graph_ = other;
  expect_stale(first);
  other.AddVariable(kValues, 2, Role::kFrame);  // as many changes as the first assignment has made
  const GraphEdit second(graph_);
  graph_ = other;
  expect_stale(first);
  expect_stale(second);
  const GraphEdit third(graph_);
  graph_ = std::move(other);
  for (const GraphEdit* edit : {&first, &second, &third}) {
    expect_stale(*edit);
  }
  edit_.Restart();
  edit_.RemoveVariable(6);
  EXPECT_TRUE(graph_.Apply(edit_).ok());
}

TEST_F(EditErrors, RemoveVariable) {
  edit_.RemoveVariable(1);
  edit_.RemoveVariable(6);
  ExpectRefused("RemoveVariable: variable 6 does not exist: the graph has 6 variables");
  edit_.RemoveVariable(-1);
  ExpectRefused("RemoveVariable: variable -1 does not exist");
  edit_.RemoveVariable(5);
  ExpectRefused("RemoveVariable: variable 5 has been removed");
  edit_.RemoveVariable(2);
  edit_.RemoveVariable(2);
  ExpectRefused("RemoveVariable: variable 2 is removed twice");
  edit_.RemoveVariable(edit_.AddVariable(kValues, 3, Role::kLandmark));
  ExpectRefused("RemoveVariable: variable 5 is added by the same edit");
}

TEST_F(EditErrors, RemoveFactor) {
  edit_.RemoveFactor({0, 0});
  edit_.RemoveFactor({0, 4});
  ExpectRefused(
      "RemoveFactor: factor 4 of family 0 (blank) does not exist: the family has 4 places");
  edit_.RemoveFactor({0, -1});
  ExpectRefused("RemoveFactor: factor -1 of family 0 (blank) does not exist");
  edit_.RemoveFactor({4, 0});
  ExpectRefused("RemoveFactor: there is no family 4");
  edit_.RemoveFactor({0, 3});
  ExpectRefused("RemoveFactor: factor 3 of family 0 (blank) has been removed");
  edit_.RemoveFactor({0, 1});
  edit_.RemoveFactor({0, 1});
  ExpectRefused("RemoveFactor: factor 1 of family 0 (blank) is removed twice");
  edit_.RemoveFactor(edit_.AddFactor(views_, {}, {0, 1}));
  ExpectRefused("RemoveFactor: factor 3 of family 0 (blank) is added by the same edit");
}

TEST_F(EditErrors, AddVariable) {
  edit_.AddVariable(nullptr, 2, Role::kFrame);
  ExpectRefused("AddVariable: variable 6 is given a null pointer");
  const double values[3] = {1.0, 2.0, std::numeric_limits<double>::infinity()};
  edit_.AddVariable(values, 3, Role::kFrame);
  ExpectRefused("AddVariable: value 2 of variable 5 is inf");
}

// The measurement would otherwise go into a family that the factor is not of.
TEST_F(EditErrors, AHandleOfAnotherFamily) {
  EXPECT_EQ(edit_.AddFactor(FamilyHandle<BlankFamily>(), {}, {0, 1}).index, -1);
  EXPECT_FALSE(edit_.empty());
  edit_.AddFactor(views_, {}, {0, 1});  // the first call that failed is named
  ExpectRefused("AddFactor: there is no family -1");
  edit_.SetMeasurement({0, 1}, FamilyHandle<BlankFamily>(), {});
  ExpectRefused("SetMeasurement: family 0 (blank) is not the family of the handle");
  edit_.SetMeasurement({0, 1}, pairs_, {});
  ExpectRefused("SetMeasurement: family 0 (blank) is not the family of the handle (blank)");
}

TEST_F(EditErrors, AddFactor) {
  edit_.AddFactor(views_, {}, {0});
  ExpectRefused("factor 3 of family 0 (blank) is given 1 variables but has 2 slots");
  edit_.AddFactor(views_, {}, {0, 5});
  ExpectRefused(
      "factor 3 of blank (variables 0, 5): slot 1 names variable 5, which has been removed");
  edit_.RemoveVariable(2);
  edit_.AddFactor(views_, {}, {0, 2});
  ExpectRefused(
      "factor 3 of blank (variables 0, 2): slot 1 names variable 2, which the same edit removes");
}

TEST_F(EditErrors, ConnectWithoutMeasurement) {
  const VariableId ids[] = {0, 1};
  edit_.Connect(0, ids);  // the free place still holds an old measurement
  const FactorId appended = edit_.Connect(0, ids);
  inceres::ExpectRefused(&graph_, edit_,
                         "factor 4 of family 0 (blank) has no measurement: the family holds 4");
  views_->Place(appended.index, {});
  std::vector<FactorId> removed;
  EXPECT_TRUE(graph_.Check(edit_, &removed).ok());
}

TEST_F(EditErrors, SetConstant) {
  edit_.SetConstant(1, true);
  edit_.SetConstant(7, true);
  ExpectRefused("SetConstant: variable 7 does not exist");
  edit_.SetConstant(5, true);
  ExpectRefused("SetConstant: variable 5 has been removed");
  edit_.SetConstant(1, true);
  edit_.RemoveVariable(1);
  ExpectRefused("SetConstant: variable 1 is removed by the same edit");
  edit_.SetConstant(4, false);
  ExpectRefused("SetConstant: variable 4 is a borrowed constant, which stays one");
}

TEST_F(EditErrors, FreeingASecondLandmark) {
  edit_.SetConstant(3, false);
  ExpectRefused(
      "SetConstant(3, false): factor 0 of blank (variables 1, 3): slot 1 is a second landmark "
      "(variable 3)");
  for (const bool remove : {true, false}) {
    edit_.Restart();
    edit_.SetConstant(3, false);
    if (remove) {
      edit_.RemoveFactor({1, 0});
    } else {
      edit_.SetConstant(1, true);
    }
    std::vector<FactorId> removed;
    EXPECT_TRUE(graph_.Check(edit_, &removed).ok());
  }
}

TEST_F(EditErrors, FreeingAVariableOfAnotherTangentSize) {
  const VariableId id = edit_.AddVariable(kValues, 3, Role::kLandmark,
                                          std::make_shared<SubsetManifold>(3, std::vector<int>{1}));
  edit_.SetConstant(id, true);
  edit_.AddFactor(views_, {}, {0, id});
  ASSERT_TRUE(graph_.Apply(edit_).ok());
  const std::string before = Dump(graph_);
  edit_.Restart();
  edit_.SetConstant(id, false);
  ExpectInvalid(graph_.Apply(edit_), "slot 1 has tangent size 3 but variable 5 has 2");
  EXPECT_EQ(Dump(graph_), before);
}

TEST_F(EditErrors, FreeingALandmarkTooLarge) {
  const VariableId id = edit_.AddVariable(kValues, 5, Role::kLandmark);
  edit_.SetConstant(id, true);
  ASSERT_TRUE(graph_.Apply(edit_).ok());
  edit_.Restart();
  edit_.SetConstant(id, false);
  ExpectInvalid(graph_.Apply(edit_), "variable 6 is a landmark of tangent size 5");
  EXPECT_TRUE(graph_.IsConstant(id));
}

TEST_F(EditErrors, SetLossAndMeasurement) {
  edit_.SetLoss({0, 1}, std::make_shared<HuberLoss>(1.0));
  edit_.SetLoss({0, 3}, nullptr);
  ExpectRefused("SetLoss: factor 3 of family 0 (blank) has been removed");
  edit_.RemoveVariable(2);
  edit_.SetLoss({0, 1}, nullptr);
  ExpectRefused("SetLoss: factor 1 of family 0 (blank) is removed by the same edit");
  edit_.SetMeasurement({0, 9}, views_, {});
  ExpectRefused("SetMeasurement: factor 9 of family 0 (blank) does not exist");
  edit_.MeasurementChanged({5, 0});
  ExpectRefused("SetMeasurement: there is no family 5");
}

TEST_F(EditErrors, SetValues) {
  edit_.SetValues(0, kValues + 3);
  edit_.SetValues(1, nullptr);
  ExpectRefused("SetValues: variable 1 is given a null pointer");
  edit_.SetValues(17, kValues);
  ExpectRefused("SetValues: variable 17 does not exist");
  edit_.SetValues(4, kValues);
  ExpectRefused("SetValues: variable 4 is a borrowed constant");
  edit_.RemoveVariable(1);
  edit_.SetValues(1, kValues);
  ExpectRefused("SetValues: variable 1 is removed by the same edit");
  const double values[2] = {1.0, std::nan("")};
  edit_.SetValues(0, values);
  ExpectRefused("SetValues: value 1 of variable 0 is nan");
}

// Of a variable that comes later the size is not known when the call is made, so what it was given
// cannot be kept.
TEST_F(EditErrors, SettingsOfAVariableThatTheEditAddsOnlyLater) {
  const std::string expected = ": variable 6 does not exist: the graph has 6 variables";
  const auto add = [this] { return edit_.AddVariable(kValues, 2, Role::kFrame); };
  edit_.SetValues(6, kValues);
  ASSERT_EQ(add(), 6);
  ExpectRefused("SetValues" + expected);
  edit_.PinLinearization(6, kValues);
  ASSERT_EQ(add(), 6);
  ExpectRefused("PinLinearization" + expected);
  edit_.SetBounds(6, kValues, nullptr);
  ASSERT_EQ(add(), 6);
  ExpectRefused("SetBounds" + expected);
  // The id of a removed variable, which the next one of its size is given.
  edit_.PinLinearization(5, kValues);
  ASSERT_EQ(edit_.AddVariable(kValues, 3, Role::kLandmark), 5);
  ExpectRefused("PinLinearization: variable 5 has been removed");
  // The right way round.
  ASSERT_EQ(add(), 6);
  edit_.PinLinearization(6, kValues);
  edit_.SetBounds(6, nullptr, kValues + 4);
  ASSERT_TRUE(graph_.Apply(edit_).ok());
  EXPECT_NE(graph_.PinnedValues(6), nullptr);
  EXPECT_NE(graph_.bounds(6), nullptr);
}

TEST_F(EditErrors, SetEliminationGroup) {
  edit_.SetEliminationGroup(0, 3);
  edit_.SetEliminationGroup(1, -2);
  ExpectRefused("SetEliminationGroup: variable 1 is given the group -2; groups are 0 or above");
  edit_.RemoveVariable(1);
  edit_.SetEliminationGroup(1, 1);
  ExpectRefused("SetEliminationGroup: variable 1 is removed by the same edit");
}

}  // namespace
}  // namespace inceres
