// Random edits against a model that keeps the graph as plain maps and knows nothing of places,
// rooms and lists.
#include <algorithm>
#include <map>
#include <set>

#include <gtest/gtest.h>

#include "inceres/problem/graph_edit.h"
#include "inceres/problem/losses.h"
#include "problem/graph_dump.h"
#include "support/random_values.h"

namespace inceres {
namespace {

class NumberedFamily final : public FactorFamily {
 public:
  using Measurement = int;

  explicit NumberedFamily(std::vector<Slot> slots) : FactorFamily(1, std::move(slots)) {}
  void Place(int index, int measurement) { PlaceIn(&numbers, index, measurement); }
  int size() const override { return static_cast<int>(numbers.size()); }
  const char* Name() const override { return "numbered"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override {
    return {batch.begin, "not to be evaluated"};
  }

  std::vector<int> numbers;
};

using Key = std::pair<FamilyId, int>;

struct ModelVariable {
  std::vector<double> values;
  Role role = Role::kFrame;
  bool constant = false;
};

struct ModelFactor {
  std::vector<VariableId> variables;
  std::shared_ptr<const Loss> loss;
  int number = 0;
};

struct Model {
  std::map<VariableId, ModelVariable> variables;
  std::map<Key, ModelFactor> factors;

  std::set<Key> FactorsOf(VariableId id) const {
    std::set<Key> keys;
    for (const auto& [key, factor] : factors) {
      if (std::count(factor.variables.begin(), factor.variables.end(), id) > 0) {
        keys.insert(key);
      }
    }
    return keys;
  }
};

class RandomEdits {
 public:
  explicit RandomEdits(unsigned seed) : random_(seed) {
    for (const std::vector<FactorFamily::Slot>& slots :
         {std::vector<FactorFamily::Slot>{{2, 2}, {3, 3}},
          {{2, 2}, {2, 2}},
          {{3, 3}},
          {{2, 2}, {2, 2}, {3, 3}}}) {
      families_.push_back(graph_.AddFamily(std::make_shared<NumberedFamily>(slots)));
    }
  }

  // One edit of up to ten changes; in some a fault at the end.
  void Step() {
    edit_.Restart();
    next_ = model_;
    expected_removed_.clear();
    set_variables_.clear();
    set_factors_.clear();
    const int num_changes = random_.Below(10);
    for (int k = 0; k < num_changes; ++k) {
      Change();
    }
    const bool faulty = random_.Below(5) == 0;
    if (faulty) {
      AddFault();
    }
    const std::string before = Dump(graph_);
    std::vector<FactorId> removed;
    const Status status = graph_.Check(edit_, &removed);
    EXPECT_EQ(status.ok(), !faulty) << status.message;
    EXPECT_EQ(Dump(graph_), before);
    if (!status.ok()) {
      return;
    }
    EXPECT_EQ(Keys(removed), expected_removed_);
    EXPECT_EQ(removed.size(), expected_removed_.size());
    graph_.Commit(edit_, removed);
    model_ = next_;
    Compare();
  }

 private:
  static std::set<Key> Keys(const std::vector<FactorId>& ids) {
    std::set<Key> keys;
    for (const FactorId id : ids) {
      keys.insert({id.family, id.index});
    }
    return keys;
  }

  // One of the things that are there now and were there then.
  template <typename Map>
  typename Map::key_type Pick(const Map& now, const Map& then, typename Map::key_type none) {
    std::vector<typename Map::key_type> keys;
    for (const auto& [key, value] : now) {
      if (then.count(key) > 0) {
        keys.push_back(key);
      }
    }
    return keys.empty()
               ? none
               : keys[static_cast<std::size_t>(random_.Below(static_cast<int>(keys.size())))];
  }

  void Change() {
    const int kind = random_.Below(20);
    if (kind < 5) {
      AddVariable();
    } else if (kind < 11) {
      AddFactor();
    } else if (kind < 14) {
      RemoveVariable();
    } else if (kind < 16) {
      RemoveFactor();
    } else if (kind < 18) {
      SetVariable();
    } else {
      SetFactor();
    }
  }

  void AddVariable() {
    if (next_.variables.size() >= 40) {
      return;
    }
    const int size = 2 + random_.Below(2);
    const std::vector<double> values = random_.Vector(static_cast<std::size_t>(size));
    const Role role = size == 3 ? Role::kLandmark : Role::kFrame;
    const VariableId id = edit_.AddVariable(values.data(), size, role);
    EXPECT_EQ(model_.variables.count(id) + next_.variables.count(id), 0u);
    // A free id of this size is taken before a new one.
    int num_taken = 0;
    for (const auto& [other, variable] : next_.variables) {
      num_taken += model_.variables.count(other) == 0 && other < graph_.num_variables() &&
                   static_cast<int>(variable.values.size()) == size;
    }
    EXPECT_EQ(id >= graph_.num_variables(), graph_.FreeVariable(size, false, num_taken) < 0);
    next_.variables[id] = {values, role, false};
  }

  void AddFactor() {
    const auto family = static_cast<FamilyId>(random_.Below(static_cast<int>(families_.size())));
    std::vector<VariableId> ids;
    for (int s = 0; s < graph_.family(family).num_slots(); ++s) {
      std::vector<VariableId> fitting;
      for (const auto& [id, variable] : next_.variables) {
        if (static_cast<int>(variable.values.size()) ==
                graph_.family(family).slot(s).ambient_size &&
            std::count(ids.begin(), ids.end(), id) == 0) {
          fitting.push_back(id);
        }
      }
      if (fitting.empty()) {
        return;
      }
      ids.push_back(
          fitting[static_cast<std::size_t>(random_.Below(static_cast<int>(fitting.size())))]);
    }
    const std::shared_ptr<const Loss> loss =
        random_.Below(3) == 0 ? std::make_shared<HuberLoss>(1.0) : nullptr;
    const int number = ++last_number_;
    const FactorId id =
        edit_.AddFactor(families_[static_cast<std::size_t>(family)], number, ids, loss);
    const Key key = {family, id.index};
    EXPECT_EQ(model_.factors.count(key) + next_.factors.count(key), 0u);
    next_.factors[key] = {ids, loss, number};
  }

  void RemoveVariable() {
    const VariableId id = Pick(next_.variables, model_.variables, -1);
    if (id < 0) {
      return;
    }
    const std::set<Key> factors = next_.FactorsOf(id);
    const bool of_this_edit = std::any_of(factors.begin(), factors.end(), [this](const Key& key) {
      return model_.factors.count(key) == 0;
    });
    if (of_this_edit || set_variables_.count(id) > 0) {
      return;
    }
    for (const Key& key : factors) {
      if (set_factors_.count(key) > 0) {
        return;
      }
    }
    edit_.RemoveVariable(id);
    next_.variables.erase(id);
    for (const Key& key : factors) {
      next_.factors.erase(key);
      expected_removed_.insert(key);
    }
  }

  void RemoveFactor() {
    const Key key = Pick(next_.factors, model_.factors, {-1, -1});
    if (key.first < 0 || set_factors_.count(key) > 0) {
      return;
    }
    edit_.RemoveFactor({key.first, key.second});
    next_.factors.erase(key);
    expected_removed_.insert(key);
  }

  void SetVariable() {
    const VariableId id = Pick(next_.variables, next_.variables, -1);
    if (id < 0) {
      return;
    }
    set_variables_.insert(id);
    ModelVariable& variable = next_.variables[id];
    if (random_.Below(2) == 0) {
      variable.constant = random_.Below(2) == 0;
      edit_.SetConstant(id, variable.constant);
      return;
    }
    variable.values = random_.Vector(variable.values.size());
    edit_.SetValues(id, variable.values.data());
  }

  void SetFactor() {
    const Key key = Pick(next_.factors, next_.factors, {-1, -1});
    if (key.first < 0) {
      return;
    }
    set_factors_.insert(key);
    ModelFactor& factor = next_.factors[key];
    const FactorId id = {key.first, key.second};
    if (random_.Below(2) == 0) {
      factor.loss = random_.Below(2) == 0 ? std::make_shared<HuberLoss>(2.0) : nullptr;
      edit_.SetLoss(id, factor.loss);
      return;
    }
    factor.number = ++last_number_;
    edit_.SetMeasurement(id, families_[static_cast<std::size_t>(key.first)], factor.number);
  }

  void AddFault() {
    static constexpr double kNone = 0.0;
    switch (random_.Below(5)) {
      case 0:
        return edit_.RemoveVariable(100000);
      case 1:
        return edit_.RemoveFactor({1, 100000});
      case 2:
        return edit_.SetLoss({9, 0}, nullptr);
      case 3:
        return edit_.SetValues(-1, &kNone);
      default:
        edit_.AddFactor(families_[2], 0, {-1});
    }
  }

  void Compare() {
    const Status valid = graph_.Validate();
    ASSERT_TRUE(valid.ok()) << valid.message;
    ASSERT_EQ(graph_.num_live_variables(), static_cast<int>(model_.variables.size()));
    ASSERT_EQ(graph_.num_factors(), static_cast<int>(model_.factors.size()));
    graph_.TrackFactors();
    for (const auto& [id, variable] : model_.variables) {
      ASSERT_TRUE(graph_.HasVariable(id));
      ASSERT_EQ(graph_.AmbientSize(id), static_cast<int>(variable.values.size()));
      ASSERT_TRUE(std::equal(variable.values.begin(), variable.values.end(), graph_.Values(id)));
      ASSERT_EQ(graph_.role(id), variable.role);
      ASSERT_EQ(graph_.IsConstant(id), variable.constant);
      std::vector<FactorId> factors;
      graph_.ForEachFactorOf(id, [&](FactorId factor) { factors.push_back(factor); });
      ASSERT_EQ(Keys(factors), model_.FactorsOf(id));
      ASSERT_EQ(Keys(factors).size(), factors.size());
    }
    for (const auto& [key, factor] : model_.factors) {
      ASSERT_TRUE(graph_.HasFactor(key.first, key.second));
      ASSERT_TRUE(std::equal(factor.variables.begin(), factor.variables.end(),
                             graph_.Variables(key.first, key.second)));
      ASSERT_EQ(graph_.loss(key.first, key.second), factor.loss.get());
      ASSERT_EQ(families_[static_cast<std::size_t>(key.first)]
                    ->numbers[static_cast<std::size_t>(key.second)],
                factor.number);
    }
  }

  test::Random random_;
  FactorGraph graph_;
  std::vector<FamilyHandle<NumberedFamily>> families_;
  GraphEdit edit_{graph_};
  Model model_;
  Model next_;
  std::set<Key> expected_removed_;
  std::set<VariableId> set_variables_;  // by this edit: may not be removed by it too
  std::set<Key> set_factors_;
  int last_number_ = 0;
};

TEST(GraphEdit, RandomEditsDoWhatAPlainModelDoes) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    RandomEdits edits(seed);
    for (int step = 0; step < 1000 && !testing::Test::HasFailure(); ++step) {
      edits.Step();
      ASSERT_FALSE(testing::Test::HasFailure()) << "seed " << seed << ", step " << step;
    }
  }
}

}  // namespace
}  // namespace inceres
