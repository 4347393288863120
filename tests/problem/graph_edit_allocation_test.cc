// Commit never allocates, and in the steady state of a sliding window neither does Check.

#include <gtest/gtest.h>

#include "inceres/problem/graph_edit.h"
#include "inceres/problem/losses.h"
#include "problem/blank_family.h"
#include "support/allocations.h"

namespace inceres {
namespace {

constexpr double kValues[3] = {1.0, 2.0, 3.0};

// A frame and a landmark come and go, each landmark seen from all frames; one loss, one constant
// and one value change each step.
class Window {
 public:
  int Step() {
    edit_.Restart();
    if (window_.size() == 8) {
      edit_.RemoveVariable(window_[0]);
      edit_.RemoveVariable(window_[1]);
      window_.erase(window_.begin(), window_.begin() + 2);
    }
    window_.push_back(edit_.AddVariable(kValues, 2, Role::kFrame));
    window_.push_back(edit_.AddVariable(kValues, 3, Role::kLandmark));
    for (std::size_t f = 0; f < window_.size(); f += 2) {
      const VariableId ids[2] = {window_[f], window_.back()};
      views_->Place(edit_.Connect(0, ids, loss_).index, {});
    }
    edit_.SetConstant(
        window_[0], even_ = !even_);  // freed again if it lives on, which looks at all its factors
    edit_.SetConstant(window_.back(), even_);
    edit_.SetConstant(window_[window_.size() / 2], !even_);
    edit_.SetValues(window_[1], kValues);
    const std::int64_t before = test::NumAllocations();
    const Status status = graph_.Check(edit_, &removed_);
    EXPECT_TRUE(status.ok()) << status.message;
    const std::int64_t before_commit = test::NumAllocations();
    graph_.Commit(edit_, removed_);
    EXPECT_EQ(test::NumAllocations(),
              before_commit);  // what could fail, Check has done, even where the graph still grows
    return static_cast<int>(test::NumAllocations() - before);
  }

 private:
  FactorGraph graph_;
  std::shared_ptr<BlankFamily> views_ =
      std::make_shared<BlankFamily>(1, std::vector<FactorFamily::Slot>{{2, 2}, {3, 3}});
  FamilyId id_ = graph_.AddFamily(views_);
  GraphEdit edit_{graph_};
  std::shared_ptr<const Loss> loss_ = std::make_shared<HuberLoss>(1.0);
  std::vector<VariableId> window_;
  std::vector<FactorId> removed_;
  bool even_ = false;
};

TEST(GraphEdit, AllocatesNothingInASlidingWindow) {
  if (!test::CanCountAllocations()) {
    GTEST_SKIP() << "this build has an allocator of its own";
  }
  Window window;
  int warming_up = 0;
  for (int step = 0; step < 20; ++step) {
    warming_up += window.Step();
  }
  EXPECT_GT(warming_up, 0);  // or the counter counts nothing
  for (int step = 0; step < 100; ++step) {
    EXPECT_EQ(window.Step(), 0) << "step " << step;
  }
}

// Pins and bounds take memory, which Check asks for: Commit has to go through.
TEST(GraphEdit, PinsAndBoundsAreAllocatedByCheck) {
  if (!test::CanCountAllocations()) {
    GTEST_SKIP() << "this build has an allocator of its own";
  }
  FactorGraph graph;
  for (int i = 0; i < 3; ++i) {
    graph.AddVariable(kValues, 3, Role::kFrame);
  }
  GraphEdit edit(graph);
  std::vector<FactorId> removed;
  for (const bool sets : {true, true, false}) {  // anew, over what is there, and away
    edit.Restart();
    for (VariableId id = 0; id < 3; ++id) {
      edit.PinLinearization(id, sets ? kValues : nullptr);
      edit.SetBounds(id, sets ? kValues : nullptr, nullptr);
    }
    ASSERT_TRUE(graph.Check(edit, &removed).ok());
    const std::int64_t before = test::NumAllocations();
    graph.Commit(edit, removed);
    EXPECT_EQ(test::NumAllocations(), before);
    EXPECT_EQ(graph.HasPins(), sets);
    EXPECT_EQ(graph.HasBounds(), sets);
  }
}

}  // namespace
}  // namespace inceres
