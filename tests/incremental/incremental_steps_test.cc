// Steps of an active set: the dog-leg path between the Cauchy point and the step, and landmarks
// that step by themselves.

#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "incremental/incremental_system.h"
#include "incremental/whole_graph.h"
#include "support/test_families.h"

namespace inceres::internal {
namespace {

// One frame x and landmarks l_i with residuals (x − 1, 3 (l_i − x) + l_i² / 10).
class Star {
 public:
  explicit Star(int num_landmarks, std::shared_ptr<const Loss> loss = nullptr,
                double landmark_damping = 0.0)
      : system_(graph_, 1) {
    const auto views =
        graph_.AddFamily(test::JetFamily<2, 1, 1>([](const auto* x, const auto* l, auto* f) {
          f[0] = x[0] - 1.0;
          f[1] = 3.0 * (l[0] - x[0]) + 0.1 * l[0] * l[0];
        }));
    const double start = 4.0;
    const VariableId frame = graph_.AddVariable(&start, 1, Role::kFrame);
    for (int i = 0; i < num_landmarks; ++i) {
      const double other = 2.0 + i;
      const VariableId landmark = graph_.AddVariable(&other, 1, Role::kLandmark);
      graph_.AddFactor(views, 0, {frame, landmark}, loss);
    }
    AddWholeGraph(&system_);
    RelinearizeWork work;
    EXPECT_TRUE(system_.Relinearize(landmark_damping, RebuildPolicy::kNever, &work).ok());
  }

  IncrementalSystem& system() { return system_; }

  // The whole Gauss–Newton step.
  void SetStep() {
    IncrementalSchur& schur = system_.schur();
    const double S = schur.S().values(schur.S().row(0).front().offset)[0];
    const double step = schur.b(0)[0] / S;
    system_.step().SetFrame(0, &step);
    for (std::int32_t l = 0; l < static_cast<std::int32_t>(schur.landmarks().size()); ++l) {
      system_.step().Visit(l);
    }
  }

  // The same, evaluated.
  double Step() {
    SetStep();
    double change = 0.0;
    double predicted = 0.0;
    EXPECT_TRUE(system_.step().Evaluate(&change, &predicted).ok());
    return predicted;
  }

 private:
  FactorGraph graph_;
  IncrementalSystem system_;
};

TEST(DoglegPath, HasTheNormAskedForAndGainsMoreTheLongerItIs) {
  Star star(4);
  IncrementalSystem& system = star.system();
  const double full_gain = star.Step();
  const double full_norm = system.step().ScaledNorm();
  ASSERT_GT(full_norm, 0.0);
  double last_gain = 0.0;
  for (const double share : {1e-3, 0.1, 0.3, 0.6, 0.9, 0.999}) {
    system.step().Shorten(share * full_norm);
    EXPECT_NEAR(system.step().ScaledNorm(), share * full_norm, 1e-9 * full_norm) << share;
    double change = 0.0;
    double predicted = 0.0;
    ASSERT_TRUE(system.step().Evaluate(&change, &predicted).ok());
    EXPECT_GT(predicted, last_gain) << "the model falls along the path";
    EXPECT_LE(predicted, full_gain * (1.0 + 1e-12));
    last_gain = predicted;
  }
  EXPECT_NEAR(last_gain, full_gain, 1e-2 * full_gain);
  system.step().Shorten(10.0 * full_norm);
  EXPECT_NEAR(system.step().ScaledNorm(), full_norm, 1e-9 * full_norm)
      << "never beyond the step itself";
}

TEST(DoglegPath, AStepIsShortenedWithoutBeingEvaluatedFirst) {
  Star evaluated(4);
  evaluated.Step();
  const double norm = 0.5 * evaluated.system().step().ScaledNorm();
  Star fresh(4);
  fresh.SetStep();
  for (IncrementalSystem* system : {&evaluated.system(), &fresh.system()}) {
    system->step().Shorten(norm);
  }
  double change[2] = {};
  double predicted[2] = {};
  ASSERT_TRUE(evaluated.system().step().Evaluate(&change[0], &predicted[0]).ok());
  ASSERT_TRUE(fresh.system().step().Evaluate(&change[1], &predicted[1]).ok());
  EXPECT_EQ(change[0], change[1]);
  EXPECT_EQ(predicted[0], predicted[1]);
  EXPECT_LT(change[0], 0.0);
}

TEST(DoglegPath, StartsDownTheGradient) {
  Star star(3);
  IncrementalSystem& system = star.system();
  star.Step();
  const double tiny = 1e-6;
  system.step().Shorten(tiny);
  double change = 0.0;
  double predicted = 0.0;
  ASSERT_TRUE(system.step().Evaluate(&change, &predicted).ok());
  EXPECT_NEAR(-change, predicted, 1e-4 * predicted)
      << "so short a step does what the gradient says";
}

// Where the gradient is zero there is no Cauchy point but zero: a path of no length ends there.
TEST(DoglegPath, OfNoLengthAtAStationaryPointIsNoStep) {
  FactorGraph graph;
  const auto family = graph.AddFamily(test::ScalarFamily([](double x) { return x; }, 1.0));
  const double zero = 0.0;
  const VariableId x = graph.AddVariable(&zero, 1, Role::kFrame);
  graph.AddFactor(family, 0, {x});
  IncrementalSystem system(graph, 1);
  AddWholeGraph(&system);
  RelinearizeWork work;
  ASSERT_TRUE(system.Relinearize(0.0, RebuildPolicy::kNever, &work).ok());
  system.step().SetFrame(0, &zero);
  system.step().Shorten(0.0);
  EXPECT_EQ(*system.step().Frame(0), 0.0);
  double change = 0.0;
  double predicted = 0.0;
  ASSERT_TRUE(system.step().Evaluate(&change, &predicted).ok());
  EXPECT_EQ(change, 0.0);
  EXPECT_EQ(predicted, 0.0);
}

TEST(LandmarkSteps, LowerTheCostAndMoveNoFrame) {
  Star star(5);
  IncrementalSystem& system = star.system();
  const double before = system.cost();
  const double frame = *system.variables().current(0);
  int num_evaluated = 0;
  ASSERT_TRUE(system.StepLandmarks({0, 1, 2, 3, 4}, &num_evaluated));
  system.step().End();
  EXPECT_EQ(num_evaluated, 5);
  EXPECT_LT(system.cost(), before);
  EXPECT_EQ(*system.variables().current(0), frame);
  double sum = 0.0;
  for (int i = 0; i < 5; ++i) {
    sum += system.families()[0].weighed().Cost(i);
  }
  EXPECT_NEAR(system.cost(), sum, 1e-12 * before);
}

// A damping of 9 leaves a tenth of the step; the next ones are as long as the slope and the
// curvature seen ask for, and stretched at most four times as much as the one before.
TEST(LandmarkSteps, DampingDoesNotMakeThemCreep) {
  constexpr double kDamping = 9.0;
  const double minimum = 5.0 * (std::sqrt(13.8) - 3.0);  // of 3 (l − 4) + l² / 10
  Star star(1, nullptr, kDamping);
  IncrementalSystem& system = star.system();
  const double start = *system.variables().current(1);
  RelinearizeWork work;
  int num_evaluated = 0;
  for (int pass = 0; pass < 3; ++pass) {
    ASSERT_TRUE(system.StepLandmarks({0}, &num_evaluated));
    system.MarkDirty({0, 0});
    system.step().End();
    ASSERT_TRUE(system.Relinearize(kDamping, RebuildPolicy::kNever, &work).ok());
    if (pass == 0) {
      EXPECT_LT(*system.variables().current(1) - start, 0.2 * (minimum - start));
    }
  }
  EXPECT_NEAR(*system.variables().current(1), minimum, 0.2 * (minimum - start));
}

TEST(LandmarkSteps, ThoseThatDoNotGainStayWhereTheyAre) {
  Star star(2);
  IncrementalSystem& system = star.system();
  RelinearizeWork work;
  // The first landmark goes to its own minimum; then only the second has anything to gain.
  int num_evaluated = 0;
  for (int pass = 0; pass < 20; ++pass) {
    if (system.StepLandmarks({0}, &num_evaluated)) {
      system.MarkDirty({0, 0});
      system.step().End();
      ASSERT_TRUE(system.Relinearize(0.0, RebuildPolicy::kNever, &work).ok());
    }
  }
  const double settled = *system.variables().current(1);
  ASSERT_TRUE(system.StepLandmarks({0, 1}, &num_evaluated));
  system.step().End();
  EXPECT_NEAR(*system.variables().current(1), settled, 1e-9);
  EXPECT_NE(*system.variables().current(2), 3.0);
}

// What is kept by difference stays good to the accuracy asked for when the cost falls by many
// orders of magnitude.
TEST(LandmarkSteps, TheGainOfAllIsRightAfterTheCostHasFallenFar) {
  Star star(3);
  IncrementalSystem& system = star.system();
  const auto set = [&system](double value) {
    system.SetValues(1, &value);
    RelinearizeWork work;
    ASSERT_TRUE(system.Relinearize(0.0, RebuildPolicy::kNever, &work).ok());
  };
  set(3e9 + 1.0 / 3.0);
  ASSERT_GT(system.schur().gains().Total(1e-9), 1e18);
  set(2.0);
  double sum = 0.0;
  for (int i = 0; i < static_cast<int>(system.schur().landmarks().size()); ++i) {
    sum += system.schur().gains()[i];
  }
  ASSERT_LT(sum, 1e3);
  EXPECT_NEAR(system.schur().gains().Total(1e-9), sum, 1e-9);
}

}  // namespace
}  // namespace inceres::internal
