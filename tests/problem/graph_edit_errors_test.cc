// Every edit that cannot be carried out is refused as a whole: the id at fault is named and nothing
// has changed.
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "inceres/problem/graph_edit.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "problem/blank_family.h"
#include "problem/graph_dump.h"

namespace inceres {
namespace {

using Slots = std::vector<FactorFamily::Slot>;
using Ids = std::vector<VariableId>;

class EditErrors : public testing::Test {
 protected:
  // Variables 0 (frame, 2 values), 1 to 3 (landmarks, 3 values, the last constant), 4 (borrowed, 2
  // values), 5 (removed). Family 0: factors 0 to 2 between the frame and each landmark, place 3
  // free. Family 1: factor 0 between 1 and 3.
  EditErrors() {
    graph_.AddVariable(kValues, 2, Role::kFrame);
    for (int l = 0; l < 3; ++l) {
      const VariableId landmark = graph_.AddVariable(kValues, 3, Role::kLandmark);
      graph_.AddFactor(views_, {}, {0, landmark});
    }
    graph_.AddBorrowedConstant(kValues, 2);
    graph_.AddVariable(kValues, 3, Role::kLandmark);
    graph_.AddFactor(views_, {}, {0, 5});
    graph_.SetConstant(3, true);
    graph_.AddFactor(pairs_, {}, {1, 3}, std::make_shared<HuberLoss>(1.0));
    GraphEdit edit(graph_);
    edit.RemoveVariable(5);
    EXPECT_TRUE(graph_.Apply(edit).ok());
    edit_.Restart();
    before_ = Dump(graph_);
  }

  void ExpectRefused(const std::string& expected) { ExpectRefused(edit_, expected); }

  void ExpectRefused(const GraphEdit& edit, const std::string& expected) {
    std::vector<FactorId> removed = {{0, 0}};
    const Status status = graph_.Check(edit, &removed);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_NE(status.message.find(expected), std::string::npos) << "message: " << status.message;
    EXPECT_TRUE(removed.empty());
    EXPECT_FALSE(graph_.Apply(edit).ok());
    EXPECT_EQ(Dump(graph_), before_);
    EXPECT_TRUE(graph_.Validate().ok());
    ExpectNoMarksLeft();
  }

  // Anything still marked as going or constant would get in the way of an edit that concerns
  // everything.
  void ExpectNoMarksLeft() {
    GraphEdit all(graph_);
    for (const VariableId id : {0, 1, 2, 4}) {
      all.RemoveVariable(id);
    }
    all.SetConstant(3, false);
    std::vector<FactorId> removed;
    const Status status = graph_.Check(all, &removed);
    EXPECT_TRUE(status.ok()) << status.message;
    EXPECT_EQ(removed.size(), 4u);
    EXPECT_EQ(Dump(graph_), before_);
  }

  static constexpr double kValues[9] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0};
  FactorGraph graph_;
  const FamilyHandle<BlankFamily> views_ =
      graph_.AddFamily(std::make_shared<BlankFamily>(1, Slots{{2, 2}, {3, 3}}));
  const FamilyHandle<BlankFamily> pairs_ =
      graph_.AddFamily(std::make_shared<BlankFamily>(1, Slots{{3, 3}, {3, 3}}));
  GraphEdit edit_{graph_};
  std::string before_;
};

TEST_F(EditErrors, AnotherGraph) {
  const FactorGraph other = graph_;
  ExpectRefused(GraphEdit(other), "the edit was begun on another graph");
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
  before_ = Dump(graph_);
  const char* const expected = " has been removed, and its place given to another one";
  edit_.RemoveFactor(first);
  ExpectRefused("RemoveFactor: factor 0 of family 0 (blank)" + std::string(expected));
  edit_.Restart();
  edit_.SetLoss(first, nullptr);
  ExpectRefused(expected);
  edit_.Restart();
  edit_.MeasurementChanged(first);
  ExpectRefused(expected);
  edit_.Restart();
  edit_.RemoveFactor(second);
  EXPECT_TRUE(graph_.Apply(edit_).ok());
  edit_.Restart();
  edit_.RemoveFactor(second);
  before_ = Dump(graph_);
  std::vector<FactorId> removed;
  EXPECT_NE(graph_.Check(edit_, &removed).message.find(" has been removed"), std::string::npos);
}

TEST_F(EditErrors, StaleAfterAnyChangeOfStructure) {
  const GraphEdit stale(graph_);
  const std::int64_t revision = graph_.revision();
  const auto expect_stale = [&] {
    before_ = Dump(graph_);
    const GraphEdit now(graph_);
    EXPECT_EQ(now.revision(), graph_.revision());
    ExpectRefused(stale, "the edit was begun at revision " + std::to_string(revision) +
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
  ExpectRefused(empty, "the edit was begun at revision");  // applied twice
}

TEST_F(EditErrors, RemoveVariable) {
  edit_.RemoveVariable(1);
  edit_.RemoveVariable(6);
  ExpectRefused("RemoveVariable: variable 6 does not exist: the graph has 6 variables");
}

TEST_F(EditErrors, RemoveNegativeVariable) {
  edit_.RemoveVariable(-1);
  ExpectRefused("RemoveVariable: variable -1 does not exist");
}

TEST_F(EditErrors, RemoveVariableThatIsGone) {
  edit_.RemoveVariable(5);
  ExpectRefused("RemoveVariable: variable 5 has been removed");
}

TEST_F(EditErrors, RemoveVariableTwice) {
  edit_.RemoveVariable(2);
  edit_.RemoveVariable(2);
  ExpectRefused("RemoveVariable: variable 2 is removed twice");
}

TEST_F(EditErrors, RemoveVariableOfTheSameEdit) {
  edit_.RemoveVariable(edit_.AddVariable(kValues, 3, Role::kLandmark));
  ExpectRefused("RemoveVariable: variable 5 is added by the same edit");
}

TEST_F(EditErrors, RemoveFactor) {
  edit_.RemoveFactor({0, 0});
  edit_.RemoveFactor({0, 4});
  ExpectRefused(
      "RemoveFactor: factor 4 of family 0 (blank) does not exist: the family has 4 places");
}

TEST_F(EditErrors, RemoveNegativeFactor) {
  edit_.RemoveFactor({0, -1});
  ExpectRefused("RemoveFactor: factor -1 of family 0 (blank) does not exist");
}

TEST_F(EditErrors, RemoveFactorOfNoFamily) {
  edit_.RemoveFactor({2, 0});
  ExpectRefused("RemoveFactor: there is no family 2");
}

TEST_F(EditErrors, RemoveFactorThatIsGone) {
  edit_.RemoveFactor({0, 3});
  ExpectRefused("RemoveFactor: factor 3 of family 0 (blank) has been removed");
}

TEST_F(EditErrors, RemoveFactorTwice) {
  edit_.RemoveFactor({0, 1});
  edit_.RemoveFactor({0, 1});
  ExpectRefused("RemoveFactor: factor 1 of family 0 (blank) is removed twice");
}

TEST_F(EditErrors, RemoveFactorOfTheSameEdit) {
  edit_.RemoveFactor(edit_.AddFactor(views_, {}, {0, 1}));
  ExpectRefused("RemoveFactor: factor 3 of family 0 (blank) is added by the same edit");
}

TEST_F(EditErrors, AddVariable) {
  edit_.AddVariable(nullptr, 2, Role::kFrame);
  ExpectRefused("AddVariable: variable 6 is given a null pointer");
}

TEST_F(EditErrors, AddVariableOfNoSize) {
  edit_.AddVariable(kValues, -3, Role::kFrame);
  ExpectRefused("variable 6 has ambient size -3");
}

TEST_F(EditErrors, AddVariableThatIsNotFinite) {
  const double values[3] = {1.0, 2.0, std::numeric_limits<double>::infinity()};
  edit_.AddVariable(values, 3, Role::kFrame);
  ExpectRefused("AddVariable: value 2 of variable 5 is inf");
}

TEST_F(EditErrors, AddVariableOnAnotherManifold) {
  edit_.AddVariable(kValues, 3, Role::kFrame, std::make_shared<QuaternionManifold>());
  ExpectRefused("variable 5 has 3 values but its manifold has ambient size 4");
}

TEST_F(EditErrors, AddLandmarkTooLarge) {
  const VariableId id = edit_.AddVariable(kValues, 5, Role::kLandmark);
  ExpectRefused("variable 6 is a landmark of tangent size 5");
  edit_.SetConstant(id, true);
  std::vector<FactorId> removed;
  EXPECT_TRUE(graph_.Check(edit_, &removed).ok());
}

TEST_F(EditErrors, AddBorrowedConstant) {
  edit_.AddBorrowedConstant(nullptr, 2);
  ExpectRefused("variable 6 is a borrowed constant with a null pointer");
}

TEST_F(EditErrors, AddBorrowedConstantThatIsNotFinite) {
  const double value = std::nan("");
  edit_.AddBorrowedConstant(&value, 1);
  ExpectRefused("variable 6 is a borrowed constant with a value that is not finite");
}

TEST_F(EditErrors, ConnectToNoFamily) {
  const Ids ids = {0, 1};
  for (const FamilyId id : {-1, 2}) {
    edit_.Restart();
    edit_.Connect(id, ids.data());
    ExpectRefused("Connect: there is no family " + std::to_string(id));
    edit_.Restart();
    EXPECT_EQ(edit_.AddFactor(FamilyHandle<BlankFamily>{id, views_.family}, {}, {0, 1}).index, -1);
    ExpectRefused("AddFactor: there is no family " + std::to_string(id) + "; the graph has 2");
  }
}

TEST_F(EditErrors, AHandleWithoutAFamily) {
  EXPECT_EQ(edit_.AddFactor(FamilyHandle<BlankFamily>(), {}, {0, 1}).index, -1);
  EXPECT_FALSE(edit_.empty());
  ExpectRefused("AddFactor: there is no family -1");
  edit_.Restart();
  EXPECT_EQ(edit_.AddFactor(FamilyHandle<BlankFamily>{0, nullptr}, {}, {0, 1}).index, -1);
  ExpectRefused("AddFactor: family 0 (blank) is not the family of the handle (which has none)");
  edit_.Restart();
  edit_.SetMeasurement({0, 1}, FamilyHandle<BlankFamily>(), {});
  ExpectRefused("SetMeasurement: family 0 (blank) is not the family of the handle");
}

// The measurement would otherwise go into a family that the factor is not of.
TEST_F(EditErrors, AHandleOfAnotherFamily) {
  const int size = pairs_->size();
  EXPECT_EQ(edit_.AddFactor(FamilyHandle<BlankFamily>{0, pairs_.family}, {}, {0, 1}).index, -1);
  edit_.AddFactor(views_, {}, {0, 1});
  ExpectRefused("AddFactor: family 0 (blank) is not the family of the handle (blank)");
  EXPECT_EQ(pairs_->size(), size);
  edit_.Restart();
  edit_.SetMeasurement({0, 1}, pairs_, {});
  ExpectRefused("SetMeasurement: family 0 (blank) is not the family of the handle (blank)");
}

TEST_F(EditErrors, ConnectWithTooFewVariables) {
  edit_.AddFactor(views_, {}, {0});
  ExpectRefused("factor 3 of family 0 (blank) is given 1 variables but has 2 slots");
}

TEST_F(EditErrors, ConnectWithoutMeasurement) {
  const Ids ids = {0, 1};
  edit_.Connect(0, ids.data());  // the free place still holds an old measurement
  const FactorId appended = edit_.Connect(0, ids.data());
  ExpectRefused("factor 4 of family 0 (blank) has no measurement: the family holds 4");
  views_->Place(appended.index, {});
  std::vector<FactorId> removed;
  EXPECT_TRUE(graph_.Check(edit_, &removed).ok());
}

TEST_F(EditErrors, ConnectToNoVariable) {
  edit_.AddFactor(views_, {}, {0, 6});
  ExpectRefused(
      "factor 3 of blank (variables 0, 6): slot 1 names variable 6, but the graph has 6 variables");
}

TEST_F(EditErrors, ConnectToARemovedVariable) {
  edit_.AddFactor(views_, {}, {0, 5});
  ExpectRefused(
      "factor 3 of blank (variables 0, 5): slot 1 names variable 5, which has been removed");
}

TEST_F(EditErrors, ConnectToAVariableThatGoes) {
  edit_.RemoveVariable(2);
  edit_.AddFactor(views_, {}, {0, 2});
  ExpectRefused(
      "factor 3 of blank (variables 0, 2): slot 1 names variable 2, which the same edit removes");
}

TEST_F(EditErrors, ConnectWithAnotherAmbientSize) {
  edit_.AddFactor(views_, {}, {1, 2});
  ExpectRefused(
      "factor 3 of blank (variables 1, 2): slot 0 has ambient size 2 but variable 1 has 3 values");
}

TEST_F(EditErrors, ConnectANewVariableWithAnotherTangentSize) {
  const VariableId id = edit_.AddVariable(kValues, 3, Role::kLandmark,
                                          std::make_shared<SubsetManifold>(3, std::vector<int>{1}));
  edit_.AddFactor(views_, {}, {0, id});
  ExpectRefused(
      "factor 3 of blank (variables 0, 5): slot 1 has tangent size 3 but variable 5 has 2");
}

TEST_F(EditErrors, ConnectTwiceToAVariable) {
  edit_.AddFactor(pairs_, {}, {1, 1});
  ExpectRefused("factor 1 of blank (variables 1, 1): slot 1 repeats variable 1");
}

TEST_F(EditErrors, ConnectTwoLandmarks) {
  edit_.AddFactor(pairs_, {}, {1, 2});
  ExpectRefused("factor 1 of blank (variables 1, 2): slot 1 is a second landmark (variable 2)");
  edit_.SetConstant(1, true);  // the state the edit leads to is what counts
  std::vector<FactorId> removed;
  EXPECT_TRUE(graph_.Check(edit_, &removed).ok());
  edit_.SetConstant(1, false);
  ExpectRefused("slot 1 is a second landmark (variable 2)");
}

TEST_F(EditErrors, FamilyWithoutResiduals) {
  const auto family = graph_.AddFamily(std::make_shared<BlankFamily>(0, Slots{{2, 2}}));
  edit_.Restart();
  edit_.AddFactor(family, {}, {0});
  const Status status = graph_.Apply(edit_);
  EXPECT_NE(status.message.find("family 2 (blank) has residual size 0"), std::string::npos)
      << status.message;
}

TEST_F(EditErrors, SetConstant) {
  edit_.SetConstant(1, true);
  edit_.SetConstant(7, true);
  ExpectRefused("SetConstant: variable 7 does not exist");
}

TEST_F(EditErrors, SetConstantOfARemovedVariable) {
  edit_.SetConstant(5, true);
  ExpectRefused("SetConstant: variable 5 has been removed");
}

TEST_F(EditErrors, SetConstantOfAVariableThatGoes) {
  edit_.SetConstant(1, true);
  edit_.RemoveVariable(1);
  ExpectRefused("SetConstant: variable 1 is removed by the same edit");
}

TEST_F(EditErrors, SetConstantOfABorrowedOne) {
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
  GraphEdit edit(graph_);
  edit.SetConstant(id, false);
  const std::string before = Dump(graph_);
  EXPECT_NE(graph_.Apply(edit).message.find("slot 1 has tangent size 3 but variable 5 has 2"),
            std::string::npos);
  EXPECT_EQ(Dump(graph_), before);
}

TEST_F(EditErrors, FreeingALandmarkTooLarge) {
  const VariableId id = edit_.AddVariable(kValues, 5, Role::kLandmark);
  edit_.SetConstant(id, true);
  ASSERT_TRUE(graph_.Apply(edit_).ok());
  GraphEdit edit(graph_);
  edit.SetConstant(id, false);
  EXPECT_NE(graph_.Apply(edit).message.find("variable 6 is a landmark of tangent size 5"),
            std::string::npos);
  EXPECT_TRUE(graph_.IsConstant(id));
}

TEST_F(EditErrors, SetLoss) {
  edit_.SetLoss({0, 1}, std::make_shared<HuberLoss>(1.0));
  edit_.SetLoss({0, 3}, nullptr);
  ExpectRefused("SetLoss: factor 3 of family 0 (blank) has been removed");
}

TEST_F(EditErrors, SetLossOfAFactorThatGoesWithItsVariable) {
  edit_.RemoveVariable(2);
  edit_.SetLoss({0, 1}, nullptr);
  ExpectRefused("SetLoss: factor 1 of family 0 (blank) is removed by the same edit");
}

TEST_F(EditErrors, SetMeasurement) {
  edit_.SetMeasurement({0, 9}, views_, {});
  ExpectRefused("SetMeasurement: factor 9 of family 0 (blank) does not exist");
}

TEST_F(EditErrors, MeasurementChanged) {
  edit_.MeasurementChanged({3, 0});
  ExpectRefused("SetMeasurement: there is no family 3");
}

TEST_F(EditErrors, SetValues) {
  edit_.SetValues(0, kValues + 3);
  edit_.SetValues(1, nullptr);
  ExpectRefused("SetValues: variable 1 is given a null pointer");
}

TEST_F(EditErrors, SetValuesOfNoVariable) {
  edit_.SetValues(17, kValues);
  ExpectRefused("SetValues: variable 17 does not exist");
}

// Of a variable that comes later the size is not known when the call is made, so what it was given
// cannot be kept.
TEST_F(EditErrors, SettingsOfAVariableThatTheEditAddsOnlyLater) {
  const std::string expected = ": variable 6 does not exist: the graph has 6 variables";
  const auto add = [this] { return edit_.AddVariable(kValues, 2, Role::kFrame); };
  edit_.SetValues(6, kValues);
  ASSERT_EQ(add(), 6);
  ExpectRefused("SetValues" + expected);
  edit_.Restart();
  edit_.PinLinearization(6, kValues);
  ASSERT_EQ(add(), 6);
  ExpectRefused("PinLinearization" + expected);
  edit_.Restart();
  edit_.SetBounds(6, kValues, nullptr);
  ASSERT_EQ(add(), 6);
  ExpectRefused("SetBounds" + expected);
  // The id of a removed variable, which the next one of its size is given.
  edit_.Restart();
  edit_.PinLinearization(5, kValues);
  ASSERT_EQ(edit_.AddVariable(kValues, 3, Role::kLandmark), 5);
  ExpectRefused("PinLinearization: variable 5 has been removed");
  // The right way round.
  edit_.Restart();
  ASSERT_EQ(add(), 6);
  edit_.PinLinearization(6, kValues);
  edit_.SetBounds(6, nullptr, kValues + 4);
  ASSERT_TRUE(graph_.Apply(edit_).ok());
  EXPECT_NE(graph_.PinnedValues(6), nullptr);
  EXPECT_NE(graph_.bounds(6), nullptr);
}

TEST_F(EditErrors, SetValuesOfABorrowedConstant) {
  edit_.SetValues(4, kValues);
  ExpectRefused("SetValues: variable 4 is a borrowed constant");
}

TEST_F(EditErrors, SetValuesOfAVariableThatGoes) {
  edit_.RemoveVariable(1);
  edit_.SetValues(1, kValues);
  ExpectRefused("SetValues: variable 1 is removed by the same edit");
}

TEST_F(EditErrors, SetValuesThatAreNotFinite) {
  const double values[2] = {1.0, std::nan("")};
  edit_.SetValues(0, values);
  ExpectRefused("SetValues: value 1 of variable 0 is nan");
}

TEST_F(EditErrors, SetEliminationGroup) {
  edit_.SetEliminationGroup(0, 3);
  edit_.SetEliminationGroup(1, -2);
  ExpectRefused("SetEliminationGroup: variable 1 is given the group -2; groups are 0 or above");
}

TEST_F(EditErrors, SetEliminationGroupOfAVariableThatGoes) {
  edit_.RemoveVariable(1);
  edit_.SetEliminationGroup(1, 1);
  ExpectRefused("SetEliminationGroup: variable 1 is removed by the same edit");
}

}  // namespace
}  // namespace inceres
