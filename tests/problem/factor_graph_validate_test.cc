// Every way a graph can be unsolvable is found and its culprit named.
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "inceres/problem/factor_graph.h"
#include "inceres/problem/manifolds.h"
#include "problem/blank_family.h"

namespace inceres {
namespace {

class Validate : public testing::Test {
 protected:
  // Variables 0 (frame, 2 values), 1 and 2 (landmarks, 3 values); family 0 with one good factor
  // between 0 and 1.
  Validate() {
    graph_.AddVariable(kValues, 2, Role::kFrame);
    graph_.AddVariable(kValues, 3, Role::kLandmark);
    graph_.AddVariable(kValues, 3, Role::kLandmark);
    graph_.AddFactor(family_, {}, {0, 1});
  }

  void ExpectError(const std::string& expected) const {
    const Status status = graph_.Validate();
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_NE(status.message.find(expected), std::string::npos) << "message: " << status.message;
  }

  FamilyId AddBlank(std::vector<FactorFamily::Slot> slots,
                    const std::vector<VariableId>& variables) {
    const auto id = graph_.AddFamily(std::make_shared<BlankFamily>(1, std::move(slots), 1));
    graph_.Connect(id, variables.data());
    return id;
  }

  static constexpr double kValues[9] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0};
  FactorGraph graph_;
  const FamilyHandle<BlankFamily> family_ = graph_.AddFamily(
      std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{2, 2}, {3, 3}}));
};

TEST_F(Validate, AcceptsAGoodGraph) {
  EXPECT_TRUE(graph_.Validate().ok());
}

TEST_F(Validate, AcceptsAnEmptyGraph) {
  EXPECT_TRUE(FactorGraph().Validate().ok());
}

TEST_F(Validate, DanglingId) {
  graph_.AddFactor(family_, {}, {0, 7});
  ExpectError(
      "factor 1 of blank (variables 0, 7): slot 1 names variable 7, but the graph has 3 variables");
}

TEST_F(Validate, FewerVariablesThanSlots) {
  EXPECT_EQ(graph_.AddFactor(family_, {}, {0}), -1);
  ExpectError(
      "AddFactor: a factor of family 0 (blank) is given 1 variable (0) but has 2 slots (of 2, 3 "
      "values)");
  EXPECT_EQ(graph_.NumFactors(family_), 1);
  EXPECT_EQ(family_->size(), 1);
}

TEST_F(Validate, MoreVariablesThanSlots) {
  EXPECT_EQ(graph_.AddFactor(family_, {}, std::vector<VariableId>(1000, 2)), -1);
  ExpectError("is given 1000 variables (2, 2, 2, 2, 2, 2, 2, 2, …) but has 2 slots");
}

TEST_F(Validate, NoVariables) {
  EXPECT_EQ(graph_.AddFactor(family_, {}, {}), -1);
  ExpectError("is given 0 variables but has 2 slots");
}

TEST_F(Validate, TheFirstCallThatFailedIsNamed) {
  EXPECT_EQ(graph_.AddFamily(nullptr), -1);
  EXPECT_EQ(graph_.AddFactor(FamilyHandle<BlankFamily>{7, family_.family}, {}, {0, 1}), -1);
  ExpectError("AddFamily: the family is a null pointer");
}

TEST_F(Validate, NoSuchFamily) {
  for (const FamilyId id : {-1, 1, 1 << 30}) {
    FactorGraph by_add = graph_, by_connect = graph_, by_connect_many = graph_;
    const VariableId variables[] = {0, 1};
    EXPECT_EQ(by_add.AddFactor(FamilyHandle<BlankFamily>{id, family_.family}, {}, {0, 1}), -1);
    EXPECT_EQ(by_connect.Connect(id, variables), -1);
    by_connect_many.ConnectMany(id, {0, 1});
    for (const FactorGraph* graph : {&by_add, &by_connect, &by_connect_many}) {
      EXPECT_NE(graph->Validate().message.find("there is no family " + std::to_string(id) +
                                               "; the graph has 1"),
                std::string::npos)
          << graph->Validate().message;
    }
    EXPECT_EQ(family_->size(), 1);
  }
}

TEST_F(Validate, AHandleOfAnotherGraph) {
  FactorGraph other;
  const auto handle = other.AddFamily(
      std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{2, 2}, {3, 3}}));
  EXPECT_EQ(graph_.AddFactor(handle, {}, {0, 1}), -1);
  ExpectError("AddFactor: family 0 (blank) is not the family of the handle (blank)");
  EXPECT_EQ(handle->size(), 0);
}

TEST_F(Validate, AHandleWithoutAFamily) {
  FactorGraph another = graph_;
  EXPECT_EQ(another.AddFactor(FamilyHandle<BlankFamily>(), {}, {0, 1}), -1);
  EXPECT_NE(another.Validate().message.find("AddFactor: there is no family -1"), std::string::npos);
  EXPECT_EQ(graph_.AddFactor(FamilyHandle<BlankFamily>{0, nullptr}, {}, {0, 1}), -1);
  ExpectError("AddFactor: family 0 (blank) is not the family of the handle (which has none)");
}

TEST_F(Validate, AnIncompleteFactorAmongMany) {
  graph_.ConnectMany(family_, {0, 1, 0});
  ExpectError(
      "ConnectMany: factors of family 0 (blank) have 2 slots (of 2, 3 values), and 3 variables are "
      "not so many each");
}

TEST_F(Validate, AsManyLossesAsFactors) {
  graph_.ConnectMany(family_, {0, 1}, std::vector<std::shared_ptr<const Loss>>(2));
  ExpectError("ConnectMany: 1 factors of family 0 (blank) are given 2 losses");
}

TEST_F(Validate, NegativeId) {
  graph_.AddFactor(family_, {}, {-1, 1});
  ExpectError("factor 1 of blank (variables -1, 1): slot 0 names variable -1");
}

TEST_F(Validate, AmbientSizeOfASlot) {
  graph_.AddFactor(family_, {}, {1, 2});
  ExpectError(
      "factor 1 of blank (variables 1, 2): slot 0 has ambient size 2 but variable 1 has 3 values");
}

TEST_F(Validate, TangentSizeOfASlot) {
  const VariableId q = graph_.AddVariable(kValues, 4, Role::kFrame);
  AddBlank({{4, 3}}, {q});
  ExpectError("factor 0 of blank (variables 3): slot 0 has tangent size 3 but variable 3 has 4");
}

TEST_F(Validate, TangentSizeOfAConstantDoesNotMatter) {
  const VariableId q = graph_.AddVariable(kValues, 4, Role::kFrame);
  const VariableId borrowed = graph_.AddBorrowedConstant(kValues, 4);
  graph_.SetConstant(q, true);
  AddBlank({{4, 3}, {4, 3}}, {q, borrowed});
  EXPECT_TRUE(graph_.Validate().ok());
}

TEST_F(Validate, AmbientSizeOfAConstantMatters) {
  const VariableId borrowed = graph_.AddBorrowedConstant(kValues, 3);
  AddBlank({{4, 3}}, {borrowed});
  ExpectError("slot 0 has ambient size 4 but variable 3 has 3 values");
}

TEST_F(Validate, VariableTwiceInAFactor) {
  AddBlank({{2, 2}, {3, 3}, {2, 2}}, {0, 1, 0});
  ExpectError("factor 0 of blank (variables 0, 1, 0): slot 2 repeats variable 0");
}

TEST_F(Validate, TwoLandmarksInAFactor) {
  const FamilyId id = AddBlank({{3, 3}, {3, 3}}, {1, 2});
  ExpectError(graph_.DescribeFactor(id, 0) + ": slot 1 is a second landmark (variable 2)");
  graph_.SetConstant(1, true);
  EXPECT_TRUE(graph_.Validate().ok());  // only one of them varies
}

// Of a factor only the slots count that have another variable than in the one before, but together
// with those that have the same.
TEST_F(Validate, AFactorLikeTheOneBeforeItButForOneSlot) {
  const VariableId landmarks[] = {1, 2};
  const VariableId frame = graph_.AddVariable(kValues, 3, Role::kFrame);
  const auto pairs = graph_.AddFamily(
      std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{3, 3}, {3, 3}}, 4));
  const auto connect = [&](VariableId a, VariableId b) {
    const VariableId ids[] = {a, b};
    graph_.Connect(pairs, ids);
  };
  connect(frame, landmarks[0]);
  connect(frame, landmarks[1]);  // another landmark in the place of the first
  connect(landmarks[0], frame);  // where there was one there is none
  EXPECT_TRUE(graph_.Validate().message.find("connected") != std::string::npos);
  connect(landmarks[0], landmarks[1]);
  ExpectError("factor 3 of blank (variables 1, 2): slot 1 is a second landmark (variable 2)");
}

TEST_F(Validate, AFactorThatRepeatsWhatTheOneBeforeItHas) {
  const VariableId frame = graph_.AddVariable(kValues, 3, Role::kFrame);
  const auto pairs = graph_.AddFamily(
      std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{3, 3}, {3, 3}}, 2));
  const VariableId good[] = {frame, 1}, bad[] = {frame, frame};
  graph_.Connect(pairs, good);
  graph_.Connect(pairs, bad);
  ExpectError("slot 1 repeats variable 3");
}

TEST_F(Validate, LandmarkTooLarge) {
  const VariableId big = graph_.AddVariable(kValues, 5, Role::kLandmark);
  ExpectError("variable 3 is a landmark of tangent size 5");
  graph_.SetConstant(big, true);
  EXPECT_TRUE(graph_.Validate().ok());
  graph_.SetConstant(big, false);
  graph_.SetRole(big, Role::kFrame);
  EXPECT_TRUE(graph_.Validate().ok());
}

TEST_F(Validate, ManifoldOfAnotherSize) {
  graph_.AddVariable(kValues, 3, Role::kFrame, std::make_shared<QuaternionManifold>());
  ExpectError("variable 3 has 3 values but its manifold has ambient size 4");
}

class OddManifold final : public Manifold {
 public:
  explicit OddManifold(int tangent_size) : tangent_size_(tangent_size) {}
  int AmbientSize() const override { return 2; }
  int TangentSize() const override { return tangent_size_; }
  bool Plus(const double*, const double*, double*) const override { return false; }
  bool PlusJacobian(const double*, double*) const override { return false; }

 private:
  int tangent_size_;
};

TEST_F(Validate, TangentSizeOfAManifold) {
  for (const int tangent_size : {-1, 3}) {
    FactorGraph graph;
    graph.AddVariable(kValues, 2, Role::kFrame, std::make_shared<OddManifold>(tangent_size));
    const Status status = graph.Validate();
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_NE(status.message.find("variable 0 has tangent size " + std::to_string(tangent_size)),
              std::string::npos);
  }
}

TEST_F(Validate, SizeOfAVariable) {
  graph_.AddVariable(kValues, 0, Role::kFrame);
  ExpectError("variable 3 has ambient size 0");
}

TEST_F(Validate, NegativeSizeOfAVariable) {
  graph_.AddVariable(kValues, -2, Role::kFrame);
  ExpectError("variable 3 has ambient size -2");
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

TEST_F(Validate, NullValues) {
  graph_.AddVariable(nullptr, 2, Role::kFrame);
  ExpectError("value 0 of variable 3 is ");
}

TEST_F(Validate, BorrowedValues) {
  double borrowed[2] = {1.0, std::nan("")};
  graph_.AddBorrowedConstant(borrowed, 2);
  ExpectError("variable 3 is a borrowed constant with a value that is not finite");
  borrowed[1] = 2.0;
  EXPECT_TRUE(graph_.Validate().ok());
  graph_.AddBorrowedConstant(nullptr, 2);
  ExpectError("variable 4 is a borrowed constant with a null pointer");
}

TEST_F(Validate, MeasurementsWithoutConnection) {
  family_->Add({});
  ExpectError("family 0 (blank) holds 2 measurements but 1 factors are connected");
}

TEST_F(Validate, ConnectionsWithoutMeasurement) {
  const VariableId ids[2] = {0, 2};
  graph_.Connect(family_, ids);
  ExpectError("family 0 (blank) holds 1 measurements but 2 factors are connected");
}

TEST_F(Validate, ResidualSize) {
  graph_.AddFamily(std::make_shared<BlankFamily>(0, std::vector<FactorFamily::Slot>{{2, 2}}));
  ExpectError("family 1 (blank) has residual size 0");
}

}  // namespace
}  // namespace inceres
