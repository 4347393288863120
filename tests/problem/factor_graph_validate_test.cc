// Every way a graph can be unsolvable that an edit cannot bring about is found and its culprit
// named: see graph_faults_test.cc for the others.
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "problem/graph_to_break.h"

namespace inceres {
namespace {

class Validate : public testing::Test {
 protected:
  void ExpectError(const std::string& expected) const {
    ExpectInvalid(graph_.Validate(), expected);
  }
  void Connect(FamilyId family, VariableId a, VariableId b) {
    const VariableId ids[] = {a, b};
    graph_.Connect(family, ids);
  }

  GraphToBreak to_break_;
  FactorGraph& graph_ = to_break_.graph;
  const FamilyHandle<BlankFamily>& views_ = to_break_.views;
};

TEST_F(Validate, AcceptsAGoodGraph) {
  EXPECT_TRUE(graph_.Validate().ok());
}

TEST_F(Validate, AcceptsAnEmptyGraph) {
  EXPECT_TRUE(FactorGraph().Validate().ok());
}

TEST_F(Validate, AsManyVariablesAsSlots) {
  const auto expect = [](const std::vector<VariableId>& ids, const std::string& expected) {
    GraphToBreak g;
    EXPECT_EQ(g.graph.AddFactor(g.views, {}, ids), -1);
    ExpectInvalid(g.graph.Validate(), "AddFactor: a factor of family 0 (blank) is given " +
                                          expected + " but has 2 slots (of 2, 3 values)");
    EXPECT_EQ(g.graph.NumFactors(g.views), 3);
    EXPECT_EQ(g.views->size(), 3);
  };
  expect({}, "0 variables");
  expect({0}, "1 variable (0)");
  expect(std::vector<VariableId>(1000, 2), "1000 variables (2, 2, 2, 2, 2, 2, 2, 2, …)");
}

TEST_F(Validate, TheFirstCallThatFailedIsNamed) {
  EXPECT_EQ(graph_.AddFamily(nullptr), -1);
  EXPECT_EQ(graph_.AddFactor(FamilyHandle<BlankFamily>{7, views_.family}, {}, {0, 1}), -1);
  ExpectError("AddFamily: the family is a null pointer");
}

TEST_F(Validate, ManyFactorsOfNoFamily) {
  for (const FamilyId id : {-1, 4, 1 << 30}) {
    FactorGraph graph = graph_;
    graph.ConnectMany(id, {0, 1});
    ExpectInvalid(graph.Validate(),
                  "there is no family " + std::to_string(id) + "; the graph has 4");
  }
}

TEST_F(Validate, AnIncompleteFactorAmongMany) {
  graph_.ConnectMany(views_, {0, 1, 0});
  ExpectError(
      "ConnectMany: factors of family 0 (blank) have 2 slots (of 2, 3 values), and 3 variables are "
      "not so many each");
}

TEST_F(Validate, AsManyLossesAsFactors) {
  graph_.ConnectMany(views_, {0, 1}, std::vector<std::shared_ptr<const Loss>>(2));
  ExpectError("ConnectMany: 1 factors of family 0 (blank) are given 2 losses");
}

TEST_F(Validate, DescribesAFactorAsItsFaultDoes) {
  graph_.AddFactor(to_break_.pairs, {}, {1, 2});
  ExpectError(graph_.DescribeFactor(to_break_.pairs, 1) +
              ": slot 1 is a second landmark (variable 2)");
}

// Of a factor only the slots count that have another variable than in the one before, but together
// with those that have the same.
TEST_F(Validate, AFactorLikeTheOneBeforeItButForOneSlot) {
  const VariableId frame = graph_.AddVariable(GraphToBreak::kValues, 3, Role::kFrame);
  const auto pairs = graph_.AddFamily(
      std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{3, 3}, {3, 3}}, 4));
  Connect(pairs, frame, 1);
  Connect(pairs, frame, 2);  // another landmark in the place of the first
  Connect(pairs, 1, frame);  // where there was one there is none
  ExpectError("connected");
  Connect(pairs, 1, 2);
  ExpectError("factor 3 of blank (variables 1, 2): slot 1 is a second landmark (variable 2)");
}

TEST_F(Validate, AFactorThatRepeatsWhatTheOneBeforeItHas) {
  const VariableId frame = graph_.AddVariable(GraphToBreak::kValues, 3, Role::kFrame);
  const auto pairs = graph_.AddFamily(
      std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{3, 3}, {3, 3}}, 2));
  Connect(pairs, frame, 1);
  Connect(pairs, frame, frame);
  ExpectError("slot 1 repeats variable 5");
}

TEST_F(Validate, ALargeLandmarkThatBecomesAFrame) {
  const VariableId big = graph_.AddVariable(GraphToBreak::kValues, 5, Role::kLandmark);
  ExpectError("variable 5 is a landmark of tangent size 5");
  graph_.SetRole(big, Role::kFrame);
  EXPECT_TRUE(graph_.Validate().ok());
}

// One fault at each place of a small state, so that no position in the vectorized check is missed.
TEST_F(Validate, ValueThatIsNotFinite) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    for (std::size_t k = 0; k < graph_.state().size(); ++k) {
      const double good = graph_.state()[k];
      graph_.mutable_state()[k] = bad;
      const std::string where = k < 2 ? "value " + std::to_string(k) + " of variable 0"
                                      : "value " + std::to_string((k - 2) % 3) + " of variable " +
                                            std::to_string(1 + (k - 2) / 3);
      ExpectError(where + " is ");
      graph_.mutable_state()[k] = good;
    }
  }
  graph_.mutable_state()[0] = std::numeric_limits<double>::max();
  graph_.mutable_state()[4] = std::numeric_limits<double>::max();
  EXPECT_TRUE(graph_.Validate().ok());  // huge but finite
}

TEST_F(Validate, PinThatIsNotFinite) {
  double pin[3] = {1.0, 2.0, 3.0};
  graph_.PinLinearization(1, pin);
  EXPECT_TRUE(graph_.Validate().ok());
  pin[2] = std::nan("");
  graph_.PinLinearization(2, pin);
  ExpectError("value 2 of the pin of variable 2 is nan");
  pin[2] = HUGE_VAL;
  graph_.PinLinearization(2, pin);
  ExpectError("value 2 of the pin of variable 2 is inf");
  graph_.PinLinearization(2, nullptr);
  EXPECT_TRUE(graph_.Validate().ok());
}

TEST_F(Validate, NullValues) {
  graph_.AddVariable(nullptr, 2, Role::kFrame);
  ExpectError("value 0 of variable 5 is ");
}

TEST_F(Validate, MeasurementsWithoutConnection) {
  views_->Add({});
  ExpectError("family 0 (blank) holds 4 measurements but 3 factors are connected");
}

TEST_F(Validate, ConnectionsWithoutMeasurement) {
  Connect(views_, 0, 2);
  ExpectError("family 0 (blank) holds 3 measurements but 4 factors are connected");
}

}  // namespace
}  // namespace inceres
