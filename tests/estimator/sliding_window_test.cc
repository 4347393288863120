// Whole runs of the window on simulated sequences.
#include <algorithm>
#include <string>

#include <gtest/gtest.h>

#include "estimator/window_sequence.h"
#include "inceres/estimator/sliding_window_estimator.h"
#include "inceres/factors/imu_preintegrator.h"

namespace inceres::test {
namespace {

TEST(SlidingWindow, RecoversTheTrajectoryOfEachPreset) {
  const struct {
    const char* preset;
    int num_frames;
    double limit;  // meters, some twice what it is
  } cases[] = {{"cubic", 50, 0.2}, {"figure_eight", 100, 0.1}, {"ellipse", 50, 0.1}};
  for (const auto& [preset, num_frames, limit] : cases) {
    const VioSequence sequence = Simulate(preset, num_frames);
    for (const WindowRule rule :
         {WindowRule::kMarginalizeLandmarks, WindowRule::kKeepSeenLandmarks}) {
      SlidingWindowOptions options = WindowOptionsOf(sequence);
      options.rule = rule;
      WindowRun run(sequence, options);
      run.Play(sequence.frames.size());
      EXPECT_LT(run.RmsError(), limit) << preset << ", rule " << static_cast<int>(rule);
      EXPECT_EQ(run.estimator.num_frames(), options.size);
    }
  }
}

TEST(SlidingWindow, FollowsUsersConventions) {
  const VioSequence sequence = Simulate("", 60);
  const SlidingWindowOptions plain = WindowOptionsOf(sequence);
  WindowRun expected(sequence, plain);
  expected.Play(60);
  SlidingWindowOptions options = plain;
  options.imu.conventions = ImuConventions::Vins(9.81);
  // or it would be another estimate
  options.imu.conventions.noise = ImuConventions::Noise::kContinuous;
  WindowRun run(sequence, options);
  run.Play(60);
  const double* speed_bias = run.estimator.solver().Values(run.estimator.SpeedBiasId(9));
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(run.summary.state.pose[k], expected.summary.state.pose[k], 1e-3);
    EXPECT_NEAR(run.summary.state.gyr_bias[k], expected.summary.state.gyr_bias[k], 1e-4);
    EXPECT_EQ(run.summary.state.acc_bias[k], speed_bias[3 + k]) << "VINS has v, b_a, b_g";
  }
}

TEST(SlidingWindow, SurvivesOutliersAndGaps) {
  VioSceneOptions scene;
  scene.num_frames = 120;
  scene.outlier_fraction = 0.03;
  scene.dropout = 0.1;
  VioSequence sequence;
  ASSERT_TRUE(GenerateVioScene(scene, &sequence).ok());
  for (std::size_t i = 60; i < 63; ++i) {
    sequence.frames[i].observations.clear();  // the camera is covered
  }
  WindowRun run(sequence, WindowOptionsOf(sequence));
  int num_rejected = 0;
  while (run.next < sequence.frames.size()) {
    num_rejected += run.Step().num_rejected_landmarks;
  }
  EXPECT_GT(num_rejected, 10);
  EXPECT_LT(run.RmsError(), 0.3);
}

TEST(SlidingWindow, WithoutFeaturesTheImuCarriesOn) {
  const VioSequence sequence = Simulate("", 30);
  SlidingWindowEstimator estimator(WindowOptionsOf(sequence));
  WindowStart start = GoodStart();
  start.state = TrueState(sequence.frames[0]);
  ASSERT_TRUE(estimator.Start(start, {}).ok());
  WindowState propagated = start.state;
  for (std::size_t i = 1; i < 30; ++i) {
    WindowFrame frame = WindowFrameOf(sequence, i);
    frame.observations.clear();
    const WindowSummary summary = estimator.AddFrame(frame);
    ASSERT_TRUE(summary.status.ok()) << summary.status.message;
    ImuPreintegrator imu(WindowOptionsOf(sequence).imu);
    ASSERT_TRUE(
        imu.Integrate(frame.imu, propagated.gyr_bias.data(), propagated.acc_bias.data()).ok());
    double speed_bias[9] = {}, next[9];
    std::copy(propagated.velocity.begin(), propagated.velocity.end(), speed_bias);
    std::copy(propagated.gyr_bias.begin(), propagated.gyr_bias.end(), speed_bias + 3);
    std::copy(propagated.acc_bias.begin(), propagated.acc_bias.end(), speed_bias + 6);
    ASSERT_TRUE(PropagateImu(imu, propagated.pose.data(), speed_bias, nullptr,
                             propagated.pose.data(), next, nullptr)
                    .ok());
    std::copy_n(next, 3, propagated.velocity.begin());
    EXPECT_LT(PoseError(summary.state.pose, propagated.pose).norm(), 1e-8) << "frame " << i;
  }
}

TEST(SlidingWindow, ASteadyWindowDoesNotGrow) {
  const VioSequence sequence = Simulate("figure_eight", 300);
  for (const bool first_estimates : {false, true}) {
    SlidingWindowOptions options = WindowOptionsOf(sequence);
    options.marginalization.first_estimate_jacobians = first_estimates;
    WindowRun run(sequence, options);
    run.Play(100);
    const FactorGraph& graph = run.estimator.solver().graph();
    int most_before = 0, most_after = 0;
    int places_before = 0, places_after = 0;
    const auto count = [&](int* variables, int* places) {
      int sum = 0;
      for (FamilyId family = 0; family < graph.num_families(); ++family) {
        sum += graph.NumFactors(family);
      }
      *variables = std::max(*variables, graph.num_variables());
      *places = std::max(*places, sum);
    };
    while (run.next < 200) {
      run.Step();
      count(&most_before, &places_before);
    }
    const int families_before = graph.num_families();
    while (run.next < 300) {
      run.Step();
      count(&most_after, &places_after);
    }
    EXPECT_LE(most_after, most_before * 1.2);  // of landmarks there are now more, now fewer
    EXPECT_LE(places_after, places_before * 1.2);
    EXPECT_LE(graph.num_families(), families_before + 2);  // priors of another shape
  }
}

TEST(SlidingWindow, TheBudgetIsKept) {
  const VioSequence sequence = Simulate("", 40);
  SlidingWindowOptions options = WindowOptionsOf(sequence);
  options.solver.function_tolerance = 0.0;
  options.solver.max_num_iterations = 3;
  WindowRun iterations(sequence, options);
  options.solver.max_num_iterations = 50;
  options.solver.max_factor_evaluations = 1;
  WindowRun work(sequence, options);
  options.solver.max_factor_evaluations = 1'000'000;
  options.solver.max_solver_time_in_seconds = 1e-9;
  WindowRun seconds(sequence, options);
  while (iterations.next < 40) {
    EXPECT_LE(iterations.Step().update.num_iterations, 3);
    // Looked at between iterations: one of them exhausts it, be it the batch solver's or not.
    EXPECT_LE(work.Step().update.num_iterations, 1);
    EXPECT_LE(seconds.Step().update.num_iterations, 1);
  }
  EXPECT_LT(iterations.RmsError(), 0.1);
}

TEST(SlidingWindow, AnyNumberOfThreadsGivesTheSameBits) {
  const VioSequence sequence = Simulate("", 40);
  SlidingWindowOptions options = WindowOptionsOf(sequence);
  WindowRun one(sequence, options);
  options.solver.num_threads = 2;
  WindowRun two(sequence, options);
  while (one.next < 40) {
    EXPECT_EQ(one.Step().state.pose, two.Step().state.pose);
  }
}

}  // namespace
}  // namespace inceres::test
