// A small version of benchmarks/window_consistency.cc: whether covariances are as large as the
// errors.
#include "estimator/window_consistency.h"

#include <utility>

#include <gtest/gtest.h>

namespace inceres::test {
namespace {

constexpr int kRuns = 20;

// Errors at different times of one run go together, over a second or two: their mean over a run of
// 4 s has some three independent parts, and over 20 runs a deviation of √(12 / 20 / 3) = 0.45.
// Three of them are allowed.
constexpr double kSlack = 1.35;

VioSceneOptions Scene() {
  VioSceneOptions scene = ConsistencyScene(40);
  scene.num_points = 150;
  return scene;
}

TEST(WindowConsistency, ErrorsAreAsLargeAsTheCovarianceSays) {
  const std::pair<bool, WindowRule> cases[] = {{true, WindowRule::kMarginalizeLandmarks},
                                               {true, WindowRule::kKeepSeenLandmarks},
                                               {false, WindowRule::kMarginalizeLandmarks}};
  for (const auto& [first_estimates, rule] : cases) {
    const PoseNees nees = MonteCarloNees(
        Scene(), kRuns, 4, [first = first_estimates, rule = rule](SlidingWindowOptions* options) {
          options->rule = rule;
          options->marginalization.first_estimate_jacobians = first;
        });
    EXPECT_NEAR(nees.Mean(), 6.0, kSlack)
        << "first estimates " << first_estimates << ", rule " << static_cast<int>(rule);
  }
}

TEST(WindowConsistency, AViewTakenAsExactMakesCovariancesTooSmall) {
  const PoseNees nees = MonteCarloNees(Scene(), kRuns, 4, [](SlidingWindowOptions* options) {
    options->landmark_form = LandmarkForm::kInverseDepth;
  });
  EXPECT_GT(nees.Mean(), 6.0 + 2.0 * kSlack) << "so the test above can fail";
}

}  // namespace
}  // namespace inceres::test
