// What is counted before a solve takes memory: landmarks wherever in a family they are, and
// Jacobians in the precision that they are kept in.
#include "linearize/memory_prediction.h"

#include <cstdint>
#include <memory>

#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/problem/graph_edit.h"
#include "linearize/evaluator.h"
#include "linearize/jacobian_places.h"
#include "linearize/layout.h"

namespace inceres::internal {
namespace {

constexpr std::int64_t kMuch = std::int64_t{1} << 40;

std::int64_t Predict(const FactorGraph& graph, bool eliminates_landmarks,
                     JacobianStorage storage = JacobianStorage::kBySlot) {
  MemoryBudget budget(kMuch);
  TakeForGraph(graph, eliminates_landmarks, storage, &budget);
  return budget.taken();
}

// One camera sees each of the points once.
class PointGraph {
 public:
  explicit PointGraph(int num_points, int num_frames_first = 0)
      : family_(graph_.AddFamily(std::make_shared<BalReprojectionFamily>())) {
    const double camera[9] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 100.0, 0.0, 0.0};
    const VariableId seen_from = graph_.AddVariable(camera, 9, Role::kFrame);
    for (int i = 0; i < num_points; ++i) {
      const double point[3] = {0.001 * i, 0.5, -2.0};
      const Role role = i < num_frames_first ? Role::kFrame : Role::kLandmark;
      const VariableId variables[] = {seen_from, graph_.AddVariable(point, 3, role)};
      family_->Add({1.0, 2.0});
      graph_.Connect(family_, variables);
    }
  }
  // A second camera sees all of them, after the first one has.
  void SeeAgain() {
    const double camera[9] = {0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 100.0, 0.0, 0.0};
    const int num_points = graph_.NumFactors(family_);
    const VariableId seen_from = graph_.AddVariable(camera, 9, Role::kFrame);
    for (int i = 0; i < num_points; ++i) {
      const VariableId variables[] = {seen_from, graph_.Variables(family_, i)[1]};
      family_->Add({1.0, 2.0});
      graph_.Connect(family_, variables);
    }
  }
  FactorGraph& graph() { return graph_; }
  FamilyId family() const { return family_; }

 private:
  FactorGraph graph_;
  FamilyHandle<BalReprojectionFamily> family_;
};

TEST(MemoryPrediction, CountsLandmarksBehindAFirstFactorWithoutOne) {
  PointGraph all(10);
  const std::int64_t incidences = Predict(all.graph(), true) - Predict(all.graph(), false);
  EXPECT_GT(incidences, 0);
  PointGraph some(10, /*num_frames_first=*/3);
  constexpr std::int64_t kOfLandmark = sizeof(LandmarkFactors) + 3 * sizeof(std::int32_t);
  EXPECT_EQ(Predict(some.graph(), true) - Predict(some.graph(), false),
            incidences - 3 * kOfLandmark);
  PointGraph none(10, /*num_frames_first=*/10);
  EXPECT_EQ(Predict(none.graph(), true), Predict(none.graph(), false));
}

TEST(MemoryPrediction, CountsLandmarksBehindAFreePlace) {
  PointGraph edited(10);
  const std::int64_t incidences = Predict(edited.graph(), true) - Predict(edited.graph(), false);
  GraphEdit edit(edited.graph());
  edit.RemoveFactor({edited.family(), 0});
  ASSERT_TRUE(edited.graph().Apply(edit).ok());
  ASSERT_FALSE(edited.graph().HasFactor(edited.family(), 0));
  EXPECT_EQ(Predict(edited.graph(), true) - Predict(edited.graph(), false), incidences);
}

TEST(MemoryPrediction, RoomToKeepEvaluationsIsTakenWhereThereIsSome) {
  PointGraph points(100);
  const Layout layout(points.graph(), true);
  const Executor executor(1);
  Evaluator evaluator(points.graph(), layout, executor);
  const std::int64_t before = evaluator.Bytes();
  MemoryBudget small(1000), large(kMuch);
  evaluator.set_memory_budget(&small);
  evaluator.MakeRoomToKeep();
  EXPECT_EQ(small.taken(), 0);
  EXPECT_EQ(evaluator.Bytes(), before);
  evaluator.set_memory_budget(&large);
  evaluator.MakeRoomToKeep();
  EXPECT_GE(large.taken(), 100 * 8 * (12 + 2 + 24));
  EXPECT_EQ(evaluator.Bytes(), before + large.taken());
}

// Counted and taken is the same, up to what else an evaluator has.
TEST(MemoryPrediction, CountsJacobiansInThePrecisionThatTheyAreKeptIn) {
  constexpr int kNumPoints = 60000;
  PointGraph points(kNumPoints);
  const Layout layout(points.graph(), true);
  const Executor executor(1);
  const Evaluator by_slot(points.graph(), layout, executor);
  const Evaluator by_factor(points.graph(), layout, executor, JacobianStorage::kByFactor);
  const Evaluator in_single(points.graph(), layout, executor, JacobianStorage::kByFactorInSingle);
  const auto predict = [&](JacobianStorage storage) {
    return Predict(points.graph(), true, storage);
  };
  // 8 quads of a factor become 6 without padding, and these quads of floats; 2,048 factors stay in
  // double. Behind the last factor there is a quad.
  constexpr std::int64_t kPadding = 64 * std::int64_t{kNumPoints};
  constexpr std::int64_t kSaved = 160 * std::int64_t{kNumPoints} - 192 * 2048;
  const std::int64_t gradient = 32 * std::int64_t{kNumPoints} + 96;
  EXPECT_EQ(by_slot.Bytes() - by_factor.Bytes(), kPadding - 32);
  EXPECT_EQ(by_slot.Bytes() - in_single.Bytes(), kSaved - gradient - 32 - 16);
  EXPECT_EQ(predict(JacobianStorage::kBySlot) - predict(JacobianStorage::kByFactor), kPadding);
  EXPECT_EQ(predict(JacobianStorage::kBySlot) - predict(JacobianStorage::kByFactorInSingle),
            kSaved - gradient);
  PointGraph few(4096);
  EXPECT_EQ(Predict(few.graph(), true, JacobianStorage::kByFactor),
            Predict(few.graph(), true, JacobianStorage::kByFactorInSingle))
      << "a strip takes what would be saved: they stay in double";
}

TEST(MemoryPrediction, CountsTheOrderOfLandmarksWhereFactorsComeInAnotherOne) {
  constexpr std::int64_t kNumFactors = 60000;
  PointGraph points(static_cast<int>(kNumFactors / 2));
  points.SeeAgain();
  const Layout layout(points.graph(), true);
  const Executor executor(1);
  const Evaluator by_slot(points.graph(), layout, executor);
  const Evaluator by_factor(points.graph(), layout, executor, JacobianStorage::kByFactor);
  // Less the order and two offsets of each factor, and a strip with its residuals; behind the last
  // factor of either there is a quad.
  constexpr std::int64_t kSaved = (64 - 12) * kNumFactors - (192 + 16) * 2048;
  EXPECT_EQ(by_slot.Bytes() - by_factor.Bytes(), kSaved - 2 * 32);
  EXPECT_EQ(
      Predict(points.graph(), true) - Predict(points.graph(), true, JacobianStorage::kByFactor),
      kSaved);
  // In the order of the factors there is nothing to count but what padding is spared.
  const Evaluator packed(points.graph(), layout, executor, JacobianStorage::kWithoutPadding);
  EXPECT_EQ(by_slot.Bytes() - packed.Bytes(), 64 * kNumFactors - 32);
  EXPECT_EQ(Predict(points.graph(), true) -
                Predict(points.graph(), true, JacobianStorage::kWithoutPadding),
            64 * kNumFactors);
}

// 256 bytes of a factor with padding: beyond 128 MiB.
TEST(MemoryPrediction, PaddingIsSparedWhereNoCacheHoldsTheJacobians) {
  constexpr int kMostFactors = (1 << 27) / 256;
  EXPECT_FALSE(IsPaddingDear(PointGraph(kMostFactors).graph()));
  EXPECT_TRUE(IsPaddingDear(PointGraph(kMostFactors + 1).graph()));
}

}  // namespace
}  // namespace inceres::internal
