// What an edit does to its graph.
#include "inceres/problem/graph_edit.h"

#include <stdexcept>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "problem/blank_family.h"
#include "problem/graph_dump.h"

namespace inceres {
namespace {

using Slots = std::vector<FactorFamily::Slot>;
using Ids = std::vector<VariableId>;

constexpr double kValues[9] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0};

// Keeps its measurements where a test can see them.
class NotedFamily final : public FactorFamily {
 public:
  using Measurement = int;

  explicit NotedFamily(Slots slots) : FactorFamily(1, std::move(slots)) {}
  void Add(int measurement) { notes.push_back(measurement); }
  void Place(int index, int measurement) {
    if (is_broken) {
      throw std::runtime_error("no notes today");
    }
    PlaceIn(&notes, index, measurement);
  }
  int size() const override { return static_cast<int>(notes.size()); }
  const char* Name() const override { return "noted"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override {
    return {batch.begin, "not to be evaluated"};
  }

  std::vector<int> notes;
  bool is_broken = false;
};

std::vector<std::pair<int, int>> FactorsOf(FactorGraph* graph, VariableId id) {
  graph->TrackFactors();
  std::vector<std::pair<int, int>> factors;
  graph->ForEachFactorOf(
      id, [&](FactorId factor) { factors.emplace_back(factor.family, factor.index); });
  return factors;
}

using Factors = std::vector<std::pair<int, int>>;

class Edit : public testing::Test {
 protected:
  // Frames 0 and 1 (2 values), landmarks 2 to 4 (3 values) each seen from both: factor 2 l + f.
  Edit() {
    graph_.AddVariable(kValues, 2, Role::kFrame);
    graph_.AddVariable(kValues + 2, 2, Role::kFrame);
    for (int l = 0; l < 3; ++l) {
      const VariableId landmark = graph_.AddVariable(kValues + l, 3, Role::kLandmark);
      for (const VariableId frame : {0, 1}) {
        graph_.AddFactor(views_, 10 * landmark + frame, {frame, landmark});
      }
    }
  }

  void Apply(const GraphEdit& edit) {
    const Status status = graph_.Apply(edit);
    ASSERT_TRUE(status.ok()) << status.message;
    const Status valid = graph_.Validate();
    EXPECT_TRUE(valid.ok()) << valid.message;
  }

  FactorGraph graph_;
  const FamilyHandle<NotedFamily> views_ =
      graph_.AddFamily(std::make_shared<NotedFamily>(Slots{{2, 2}, {3, 3}}));
};

TEST_F(Edit, GivesOutIdsAtOnceAndAddsTogether) {
  GraphEdit edit(graph_);
  EXPECT_TRUE(edit.empty());
  const double borrowed[2] = {7.0, 8.0};
  const VariableId landmark =
      edit.AddVariable(kValues, 3, Role::kLandmark, std::make_shared<SphereManifold>(3));
  const VariableId constant = edit.AddBorrowedConstant(borrowed, 2);
  EXPECT_EQ(landmark, 5);
  EXPECT_EQ(constant, 6);
  edit.SetConstant(landmark, true);
  const auto loss = std::make_shared<HuberLoss>(1.0);
  const FactorId plain = edit.AddFactor(views_, 60, {constant, landmark});
  const FactorId robust = edit.AddFactor(views_, 61, {1, landmark}, loss);
  EXPECT_EQ(plain.index, 6);
  EXPECT_EQ(robust.index, 7);
  EXPECT_FALSE(edit.empty());
  EXPECT_EQ(graph_.num_variables(), 5);
  EXPECT_EQ(graph_.num_factors(), 6);
  Apply(edit);
  EXPECT_EQ(graph_.num_live_variables(), 7);
  EXPECT_EQ(graph_.num_factors(), 8);
  EXPECT_TRUE(graph_.HasVariable(landmark));
  EXPECT_EQ(graph_.TangentSize(landmark), 2);
  EXPECT_EQ(graph_.role(landmark), Role::kLandmark);
  EXPECT_TRUE(graph_.IsConstant(landmark));
  EXPECT_EQ(graph_.Values(landmark)[2], 3.0);
  EXPECT_EQ(graph_.Values(constant), borrowed);
  EXPECT_EQ(graph_.Variables(views_, plain.index)[0], constant);
  EXPECT_EQ(graph_.loss(views_, plain.index), nullptr);
  EXPECT_EQ(graph_.loss(views_, robust.index), loss.get());
  EXPECT_EQ(graph_.loss(views_, 0), nullptr);
}

TEST_F(Edit, RemovesAVariableWithItsFactors) {
  GraphEdit edit(graph_);
  edit.RemoveFactor({views_, 5});
  edit.RemoveVariable(3);
  std::vector<FactorId> removed;
  const std::string before = Dump(graph_);
  ASSERT_TRUE(graph_.Check(edit, &removed).ok());
  EXPECT_EQ(Dump(graph_), before);
  ASSERT_EQ(removed.size(), 3u);
  EXPECT_EQ(removed[0].index, 5);
  EXPECT_EQ(removed[1].index + removed[2].index, 2 + 3);
  graph_.Commit(edit, removed);
  EXPECT_TRUE(graph_.Validate().ok());
  EXPECT_FALSE(graph_.HasVariable(3));
  EXPECT_TRUE(graph_.IsConstant(3));
  EXPECT_EQ(graph_.num_variables(), 5);
  EXPECT_EQ(graph_.num_live_variables(), 4);
  EXPECT_EQ(graph_.NumFactors(views_), 6);
  EXPECT_EQ(graph_.NumFreePlaces(views_), 3);
  EXPECT_EQ(graph_.num_factors(), 3);
  for (int i = 0; i < 6; ++i) {
    const bool there = i != 2 && i != 3 && i != 5;
    EXPECT_EQ(graph_.HasFactor(views_, i), there);
    EXPECT_EQ(graph_.Variables(views_, i)[0] >= 0, there);
  }
  EXPECT_EQ(FactorsOf(&graph_, 1), (Factors{{0, 1}}));
  EXPECT_EQ(FactorsOf(&graph_, 0), (Factors{{0, 4}, {0, 0}}));
  EXPECT_EQ(FactorsOf(&graph_, 3), Factors());
}

TEST_F(Edit, HasNeitherStrangersNorTheRemoved) {
  EXPECT_FALSE(graph_.HasVariable(-1));
  EXPECT_FALSE(graph_.HasVariable(5));
  EXPECT_TRUE(graph_.HasVariable(4));
  EXPECT_FALSE(graph_.HasFactor(-1, 0));
  EXPECT_FALSE(graph_.HasFactor(1, 0));
  EXPECT_FALSE(graph_.HasFactor(0, -1));
  EXPECT_FALSE(graph_.HasFactor(0, 6));
  EXPECT_TRUE(graph_.HasFactor(0, 5));
}

TEST_F(Edit, ReusesIdsOfTheSameSizeAndTheirRoom) {
  GraphEdit edit(graph_);
  edit.RemoveVariable(2);
  edit.RemoveVariable(0);
  edit.RemoveVariable(4);
  Apply(edit);
  const std::size_t room = graph_.state().size();
  EXPECT_EQ(graph_.state()[0], 0.0);
  EXPECT_EQ(graph_.FreeVariable(3, false, 0), 4);
  EXPECT_EQ(graph_.FreeVariable(3, false, 1), 2);
  EXPECT_EQ(graph_.FreeVariable(3, false, 2), -1);
  EXPECT_EQ(graph_.FreeVariable(2, false, 0), 0);
  EXPECT_EQ(graph_.FreeVariable(7, false, 0), -1);

  GraphEdit next(graph_);
  EXPECT_EQ(next.AddVariable(kValues + 5, 3, Role::kFrame), 4);
  EXPECT_EQ(next.AddVariable(kValues, 1, Role::kLandmark), 5);
  EXPECT_EQ(next.AddVariable(kValues, 3, Role::kLandmark), 2);
  EXPECT_EQ(next.AddVariable(kValues + 1, 3, Role::kLandmark), 6);
  EXPECT_EQ(next.AddVariable(kValues + 7, 2, Role::kFrame), 0);
  Apply(next);
  EXPECT_EQ(graph_.state().size(), room + 1 + 3);
  EXPECT_EQ(graph_.Values(4)[0], 6.0);
  EXPECT_EQ(graph_.role(4), Role::kFrame);
  EXPECT_EQ(graph_.TangentSize(4), 3);
  EXPECT_FALSE(graph_.IsConstant(4));
  EXPECT_EQ(graph_.Values(0)[1], 9.0);
  EXPECT_EQ(graph_.num_live_variables(), 7);
}

// A borrowed constant has no room in the state, so its id is not one for a variable that needs
// some.
TEST_F(Edit, BorrowedConstantsReuseTheirOwnIds) {
  GraphEdit edit(graph_);
  edit.AddBorrowedConstant(kValues, 2);
  Apply(edit);
  edit.Restart();
  edit.RemoveVariable(5);
  edit.RemoveVariable(0);
  Apply(edit);
  edit.Restart();
  EXPECT_EQ(edit.AddBorrowedConstant(kValues, 3), 6);
  EXPECT_EQ(edit.AddBorrowedConstant(kValues + 1, 2), 5);
  EXPECT_EQ(edit.AddVariable(kValues, 2, Role::kFrame), 0);
  Apply(edit);
  EXPECT_EQ(graph_.StateOffset(0), 0);
  EXPECT_EQ(graph_.Values(5), kValues + 1);
}

TEST_F(Edit, ReusesPlaces) {
  GraphEdit edit(graph_);
  edit.SetLoss({views_, 1}, std::make_shared<HuberLoss>(1.0));
  Apply(edit);
  edit.Restart();
  edit.RemoveFactor({views_, 1});
  edit.RemoveFactor({views_, 4});
  Apply(edit);
  EXPECT_EQ(graph_.loss(views_, 1), nullptr);
  EXPECT_EQ(graph_.FreePlace(views_, 0), 4);
  EXPECT_EQ(graph_.FreePlace(views_, 1), 1);
  EXPECT_EQ(graph_.FreePlace(views_, 2), -1);
  edit.Restart();
  EXPECT_EQ(edit.AddFactor(views_, 77, {1, 2}).index, 4);
  EXPECT_EQ(edit.AddFactor(views_, 78, {0, 4}).index, 1);
  EXPECT_EQ(edit.AddFactor(views_, 79, {0, 2}).index, 6);
  Apply(edit);
  EXPECT_EQ(views_->notes, (std::vector<int>{20, 78, 30, 31, 77, 41, 79}));
  EXPECT_EQ(graph_.NumFreePlaces(views_), 0);
  EXPECT_EQ(FactorsOf(&graph_, 2), (Factors{{0, 6}, {0, 4}, {0, 0}}));
  EXPECT_EQ(graph_.Variables(views_, 1)[1], 4);
}

// What an edit frees is used by the next one only.
TEST_F(Edit, RoomFreedByAnEditIsNotUsedByIt) {
  GraphEdit edit(graph_);
  edit.RemoveVariable(4);
  EXPECT_EQ(edit.AddVariable(kValues, 3, Role::kLandmark), 5);
  EXPECT_EQ(edit.AddFactor(views_, 50, {0, 5}).index, 6);
  Apply(edit);
  EXPECT_EQ(GraphEdit(graph_).AddVariable(kValues, 3, Role::kLandmark), 4);
  EXPECT_EQ(graph_.num_factors(), 5);
}

// The order of the calls does not matter, but of several settings of one thing the last one holds.
TEST_F(Edit, SettingsComeAfterAdditionsAndTheLastOneHolds) {
  GraphEdit edit(graph_);
  const auto loss = std::make_shared<HuberLoss>(1.0);
  edit.SetValues(1, kValues + 4);
  edit.SetConstant(1, true);
  edit.SetMeasurement({views_, 2}, views_, 90);
  edit.SetLoss({views_, 2}, nullptr);
  edit.SetValues(1, kValues + 6);
  edit.SetConstant(1, false);
  edit.SetConstant(0, false);
  edit.SetConstant(0, true);
  edit.SetMeasurement({views_, 2}, views_, 91);
  edit.SetLoss({views_, 2}, loss);
  const VariableId landmark = edit.AddVariable(kValues, 3, Role::kLandmark);
  edit.SetValues(landmark, kValues + 3);
  const FactorId factor = edit.AddFactor(views_, 92, {0, landmark}, loss);
  edit.SetMeasurement(factor, views_, 93);
  edit.SetLoss(factor, nullptr);
  edit.MeasurementChanged({views_, 0});
  EXPECT_EQ(views_->notes[2], 30);
  Apply(edit);
  EXPECT_EQ(graph_.Values(1)[0], 7.0);
  EXPECT_FALSE(graph_.IsConstant(1));
  EXPECT_TRUE(graph_.IsConstant(0));
  EXPECT_EQ(views_->notes[2], 91);
  EXPECT_EQ(graph_.loss(views_, 2), loss.get());
  EXPECT_EQ(graph_.Values(landmark)[0], 4.0);
  EXPECT_EQ(views_->notes[6], 93);
  EXPECT_EQ(graph_.loss(views_, factor.index), nullptr);
}

// A refused or abandoned edit may have left measurements in the family; the next one writes over
// them.
TEST_F(Edit, AnAbandonedEditLeavesNothingToTripOver) {
  {
    GraphEdit abandoned(graph_);
    abandoned.AddFactor(views_, 1000, {0, 2});
    abandoned.AddFactor(views_, 1001, {0, 2});
  }
  GraphEdit edit(graph_);
  edit.AddFactor(views_, 99, {0, 2});
  Apply(edit);
  EXPECT_EQ(views_->notes[6], 99);
  EXPECT_EQ(graph_.num_factors(), 7);
}

// Nor does a factor that is added the plain way get that measurement, or the one behind it.
TEST_F(Edit, PlainFactorsHaveTheirOwnMeasurementsAfterARefusedEdit) {
  GraphEdit refused(graph_);
  refused.AddFactor(views_, 1000, {0, 2});
  refused.AddFactor(views_, 1001, {0, 999});
  ASSERT_FALSE(graph_.Apply(refused).ok());
  ASSERT_EQ(graph_.NumFactors(views_), 6);
  for (const int note : {7, 8, 9}) {
    const int index = graph_.AddFactor(views_, note, {0, 2});
    EXPECT_EQ(views_->notes[static_cast<std::size_t>(index)], note);
  }
  EXPECT_TRUE(graph_.Validate().ok());
}

// Whatever it was refused for, and though the graph was never edited before.
TEST_F(Edit, TheGraphIsValidAfterItsFirstEditWasRefused) {
  for (const bool is_late : {false, true}) {
    FactorGraph graph;
    const auto family = graph.AddFamily(std::make_shared<NotedFamily>(Slots{{1, 1}}));
    const double value = 1.0;
    const VariableId id = graph.AddVariable(&value, 1, Role::kFrame);
    GraphEdit edit(graph);
    edit.AddFactor(family, 0, {id});
    if (is_late) {
      graph.AddVariable(&value, 1, Role::kFrame);
    } else {
      edit.AddFactor(FamilyHandle<NotedFamily>(), 0, {id});
    }
    ASSERT_FALSE(graph.Apply(edit).ok());
    EXPECT_TRUE(graph.Validate().ok()) << graph.Validate().message;
  }
}

// Variables and factors added the plain way, even in the wrong order, are known to later edits.
TEST_F(Edit, PlainAdditionsJoinTheListsOfFactors) {
  GraphEdit edit(graph_);
  edit.RemoveVariable(3);
  Apply(edit);
  views_->Add(1);
  const Ids early = {0, 5};
  graph_.Connect(views_, early.data());
  EXPECT_FALSE(graph_.Validate().ok());
  EXPECT_EQ(graph_.AddVariable(kValues, 3, Role::kLandmark), 5);
  graph_.AddFactor(views_, 2, {1, 5});
  EXPECT_TRUE(graph_.Validate().ok());
  EXPECT_EQ(FactorsOf(&graph_, 5), (Factors{{0, 7}, {0, 6}}));
  edit.Restart();
  edit.RemoveVariable(5);
  Apply(edit);
  EXPECT_EQ(graph_.num_factors(), 4);
  EXPECT_EQ(FactorsOf(&graph_, 1), (Factors{{0, 5}, {0, 1}}));
}

// Lists are first made while an edit is looked at that fills a place: its factor has no variables
// yet, and joins the lists when it comes.
TEST_F(Edit, AFactorThatComesToAFreePlaceIsListedFromTheStart) {
  GraphEdit edit(graph_);
  edit.RemoveFactor({views_, 1});
  Apply(edit);
  EXPECT_FALSE(graph_.TracksFactors());
  edit.Restart();
  EXPECT_EQ(edit.AddFactor(views_, 99, {0, 2}).index, 1);
  edit.RemoveVariable(4);
  Apply(edit);
  EXPECT_TRUE(graph_.TracksFactors()) << "or each later edit walks over all factors";
  EXPECT_EQ(FactorsOf(&graph_, 2), (Factors{{0, 1}, {0, 0}}));
  EXPECT_EQ(FactorsOf(&graph_, 0), (Factors{{0, 1}, {0, 2}, {0, 0}}));
}

TEST_F(Edit, ValidateFindsAPlainFactorOfARemovedVariable) {
  GraphEdit edit(graph_);
  edit.RemoveVariable(3);
  Apply(edit);
  graph_.AddFactor(views_, 2, {1, 3});
  EXPECT_NE(graph_.Validate().message.find("slot 1 names variable 3, which has been removed"),
            std::string::npos);
}

// Pins and bounds are prepared by Check; of two for a variable the later one holds, also where one
// of them lets go.
TEST_F(Edit, OfPinsAndBoundsTheLastOneHolds) {
  GraphEdit edit(graph_);
  edit.PinLinearization(0, kValues);
  edit.PinLinearization(0, kValues + 1);
  edit.PinLinearization(1, kValues);
  edit.PinLinearization(1, nullptr);
  edit.SetBounds(2, kValues, nullptr);
  edit.SetBounds(2, kValues + 1, kValues + 4);
  edit.SetBounds(3, kValues, kValues + 4);
  edit.SetBounds(3, nullptr, nullptr);
  Apply(edit);
  ASSERT_NE(graph_.PinnedValues(0), nullptr);
  EXPECT_EQ(graph_.PinnedValues(0)[0], 2.0);
  EXPECT_EQ(graph_.PinnedValues(1), nullptr);
  ASSERT_NE(graph_.bounds(2), nullptr);
  EXPECT_EQ(graph_.bounds(2)->lower, (std::vector<double>{2.0, 3.0, 4.0}));
  EXPECT_EQ(graph_.bounds(2)->upper, (std::vector<double>{5.0, 6.0, 7.0}));
  EXPECT_EQ(graph_.bounds(3), nullptr);
  // Over those that are there, and lifted again; what was checked and never carried out is not.
  edit.Restart();
  edit.PinLinearization(1, kValues);
  std::vector<FactorId> removed;
  ASSERT_TRUE(graph_.Check(edit, &removed).ok());
  edit.Restart();
  edit.PinLinearization(0, kValues + 5);
  edit.SetBounds(2, nullptr, nullptr);
  Apply(edit);
  EXPECT_EQ(graph_.PinnedValues(0)[0], 6.0);
  EXPECT_EQ(graph_.PinnedValues(1), nullptr);
  EXPECT_FALSE(graph_.HasBounds());
}

// What the user's family throws passes through; of the graph nothing has changed.
TEST_F(Edit, AFamilyThatThrowsLeavesTheGraphAsItWas) {
  GraphEdit edit(graph_);
  edit.RemoveVariable(3);
  edit.AddFactor(views_, 99, {1, 2});
  edit.SetMeasurement({views_, 0}, views_, 50);
  edit.SetConstant(0, true);
  const std::string before = Dump(graph_);
  views_->is_broken = true;
  EXPECT_THROW(static_cast<void>(graph_.Apply(edit)), std::runtime_error);
  EXPECT_EQ(Dump(graph_), before);
  EXPECT_TRUE(graph_.Validate().ok());
  views_->is_broken = false;
  Apply(edit);
  EXPECT_EQ(views_->notes[0], 50);
  EXPECT_EQ(graph_.num_factors(), 5);
}

TEST_F(Edit, ACopyIsAGraphOfItsOwn) {
  GraphEdit edit(graph_);
  edit.RemoveVariable(3);
  Apply(edit);
  FactorGraph copy = graph_;
  EXPECT_EQ(Dump(copy), Dump(graph_));
  GraphEdit more(copy);
  more.RemoveVariable(0);
  EXPECT_TRUE(copy.Apply(more).ok());
  EXPECT_EQ(copy.num_factors(), 2);
  EXPECT_EQ(graph_.num_factors(), 4);
  EXPECT_TRUE(graph_.HasVariable(0));
}

TEST_F(Edit, ASlidingWindowDoesNotGrow) {
  std::vector<VariableId> window;
  GraphEdit edit(graph_);
  int num_variables = 0;
  int num_places = 0;
  std::size_t num_values = 0;
  for (int step = 0; step < 200; ++step) {
    edit.Restart();
    if (window.size() >= 6) {
      edit.RemoveVariable(window[0]);
      edit.RemoveVariable(window[1]);
      window.erase(window.begin(), window.begin() + 2);
    }
    const VariableId frame = edit.AddVariable(kValues, 2, Role::kFrame);
    const VariableId landmark = edit.AddVariable(kValues, 3, Role::kLandmark);
    window.insert(window.end(), {frame, landmark});
    for (std::size_t f = 0; f < window.size(); f += 2) {
      edit.AddFactor(views_, step, {window[f], landmark});
    }
    Apply(edit);
    if (step == 10) {
      num_variables = graph_.num_variables();
      num_places = graph_.NumFactors(views_);
      num_values = graph_.state().size();
    }
  }
  EXPECT_EQ(graph_.num_variables(), num_variables);
  EXPECT_EQ(graph_.NumFactors(views_), num_places);
  EXPECT_EQ(graph_.state().size(), num_values);
  EXPECT_EQ(views_->size(), num_places);
  EXPECT_EQ(graph_.num_live_variables(), 5 + 6);
}

TEST_F(Edit, AGroupGoesWithItsVariable) {
  GraphEdit edit(graph_);
  edit.SetEliminationGroup(1, 2);
  edit.SetEliminationGroup(1, 4);
  const VariableId id = edit.AddVariable(kValues, 2, Role::kFrame);
  edit.SetEliminationGroup(id, 1);
  EXPECT_FALSE(edit.empty());
  Apply(edit);
  EXPECT_EQ(graph_.elimination_group(1), 4);
  EXPECT_EQ(graph_.elimination_group(id), 1);
  EXPECT_TRUE(graph_.HasEliminationGroups());
  edit.Restart();
  EXPECT_TRUE(edit.empty());
  edit.RemoveVariable(1);
  edit.RemoveVariable(id);
  Apply(edit);
  EXPECT_FALSE(graph_.HasEliminationGroups());
  edit.Restart();
  const VariableId again = edit.AddVariable(kValues, 2, Role::kFrame);
  Apply(edit);
  EXPECT_EQ(graph_.elimination_group(again), 0) << "an id that is used again";
}

}  // namespace
}  // namespace inceres
