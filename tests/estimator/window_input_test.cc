// Bad input is named, and nothing is lost.
#include <cstdint>
#include <functional>
#include <limits>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "estimator/window_sequence.h"

namespace inceres::test {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(WindowInput, OptionsAreChecked) {
  const std::pair<std::function<void(SlidingWindowOptions*)>, const char*> faults[] = {
      {[](auto* o) { o->size = 2; }, "::size = 2 but must be between 3 and 1000"},
      {[](auto* o) { o->min_tracked = -1; }, "::min_tracked = -1 but must be >= 0"},
      {[](auto* o) { o->min_parallax = kNan; }, "::min_parallax = nan but must be >= 0"},
      {[](auto* o) { o->feature_sigma[1] = 0.0; },
       "::feature_sigma[1] = 0 but must be positive and finite"},
      {[](auto* o) { o->min_triangulation_parallax = -1.0; },
       "::min_triangulation_parallax = -1 but must be positive and finite"},
      {[](auto* o) { o->max_mean_error = 0.0; }, "::max_mean_error = 0 but must be > 0"},
      {[](auto* o) { o->body_from_camera[6] = 2.0; },
       ": the quaternion of body_from_camera is not of unit length"},
      {[](auto* o) { o->body_from_camera[0] = kNan; }, ": body_from_camera is not finite"},
      {[](auto* o) { o->imu.conventions = ImuConventions::Okvis(); },
       ": imu.conventions.perturbation is kLeft; the reprojections are written for kRight"}};
  for (const auto& [spoil, what] : faults) {
    SlidingWindowOptions options;
    spoil(&options);
    SlidingWindowEstimator estimator(options);
    const Status status = estimator.Start({}, {});
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_EQ(status.message, std::string("SlidingWindowOptions") + what);
    EXPECT_EQ(estimator.num_frames(), 0);
  }
  SlidingWindowOptions options;
  options.solver.num_threads = 0;
  EXPECT_FALSE(SlidingWindowEstimator(options).Start({}, {}).ok());
  options = {};
  options.marginalization.epsilon = -1.0;
  EXPECT_FALSE(SlidingWindowEstimator(options).Start({}, {}).ok());
  options = {};
  options.imu.noise.gyr = 0.0;
  EXPECT_FALSE(SlidingWindowEstimator(options).Start({}, {}).ok());
}

TEST(WindowInput, TheStartIsChecked) {
  SlidingWindowEstimator estimator{SlidingWindowOptions()};
  EXPECT_EQ(estimator.AddFrame({}).status.message,
            "SlidingWindowEstimator: Start must come before AddFrame");
  WindowStart start;
  start.state.velocity[1] = kNan;
  EXPECT_EQ(estimator.Start(start, {}).message,
            "frame at 0 s: the state at the start is not finite");
  start = {};
  start.state.pose[6] = 0.5;
  EXPECT_EQ(estimator.Start(start, {}).message,
            "frame at 0 s: the quaternion at the start is not of unit length");
  start = {};
  start.acc_bias_sigma[2] = 0.0;
  EXPECT_EQ(estimator.Start(start, {}).message,
            "frame at 0 s: a standard deviation of the start is not positive and finite");
  EXPECT_EQ(estimator.Start({}, {{5, {0.1, kNan}}}).message,
            "frame at 0 s: the observation of track 5 is not finite");
  EXPECT_EQ(estimator.num_frames(), 0);
  EXPECT_TRUE(estimator.Start({}, {}).ok());
  EXPECT_EQ(estimator.Start({}, {}).message, "SlidingWindowEstimator: Start was called before");
}

TEST(WindowInput, AFrameWithBadInputChangesNothing) {
  const VioSequence sequence = Simulate("", 30);
  const SlidingWindowOptions options = WindowOptionsOf(sequence);
  WindowRun clean(sequence, options), bothered(sequence, options);
  const std::pair<std::function<void(WindowFrame*)>, const char*> faults[] = {
      {[](auto* f) { f->time = kNan; }, "its time is not finite"},
      {[](auto* f) { f->time = 0.0; }, "does not come after the last one"},
      {[](auto* f) { f->imu.clear(); }, "there are none"},
      {[](auto* f) { f->imu[3].acc[1] = kNan; }, "IMU sample 3 of .* is not finite"},
      {[](auto* f) { std::swap(f->imu[4], f->imu[5]); },
       "IMU sample 5 of .* is not after the one before it"},
      {[](auto* f) { f->imu.erase(f->imu.begin(), f->imu.begin() + 2); },
       ""},  // do not reach back to the last frame
      {[](auto* f) { f->imu.pop_back(); }, ""},
      {[](auto* f) { f->observations[2].point[0] = kNan; }, "is not finite"},
      {[](auto* f) { f->observations[2].track = f->observations[7].track; }, "is observed twice"}};
  while (clean.next < sequence.frames.size()) {
    for (const auto& [spoil, what] : faults) {
      WindowFrame frame = WindowFrameOf(sequence, bothered.next);
      spoil(&frame);
      const WindowSummary summary = bothered.estimator.AddFrame(frame);
      EXPECT_EQ(summary.status.code, StatusCode::kInvalidArgument);
      EXPECT_TRUE(std::regex_search(summary.status.message, std::regex(what)))
          << summary.status.message;
      EXPECT_NE(summary.status.message, "");
      EXPECT_EQ(summary.state.time, sequence.frames[bothered.next - 1].time);
    }
    EXPECT_EQ(clean.Step().state.pose, bothered.Step().state.pose);
  }
}

// The caller's summary is used again: of the frame before it keeps the memory only.
TEST(WindowInput, AFrameWithBadInputHasNoSolve) {
  const VioSequence sequence = Simulate("", 8);
  WindowRun run(sequence, WindowOptionsOf(sequence));
  run.Play(5);
  const UpdateSummary& update = run.summary.update;
  ASSERT_FALSE(update.iterations.empty());
  const std::size_t capacity = update.iterations.capacity();
  run.estimator.AddFrame({}, &run.summary);
  EXPECT_EQ(run.summary.status.code, StatusCode::kInvalidArgument);
  EXPECT_EQ(run.summary.state.time, sequence.frames[4].time);
  EXPECT_EQ(update.ToJson(), UpdateSummary().ToJson());
  EXPECT_EQ(update.iterations.capacity(), capacity);
}

TEST(WindowInput, WhatIsNotThereHasNoReadOut) {
  const VioSequence sequence = Simulate("", 8);
  WindowRun run(sequence, WindowOptionsOf(sequence));
  run.Play(8);
  std::array<double, 225> covariance{};
  EXPECT_EQ(run.estimator.StateCovariance(8, &covariance).message,
            "the window has no frame 8, but 8");
  EXPECT_EQ(run.estimator.StateCovariance(-1, &covariance).code, StatusCode::kInvalidArgument);
  std::array<double, 3> point{};
  std::vector<double> hessian{7.0};
  EXPECT_EQ(run.estimator.LandmarkPosition(123456, &point).message,
            "track 123456 has no landmark in the window");
  EXPECT_EQ(run.estimator.LandmarkHessian(123456, &hessian).message,
            "track 123456 has no landmark in the window");
  EXPECT_EQ(hessian, std::vector<double>{7.0});
  EXPECT_TRUE(run.estimator.PriorSpectrum().empty());
}

// A solve that fails keeps the frame where the IMU puts it, and the next one goes on.
TEST(WindowInput, AFailedSolveLosesNothing) {
  const VioSequence sequence = Simulate("", 40);
  WindowRun run(sequence, WindowOptionsOf(sequence));
  run.Play(15);
  WindowFrame frame = WindowFrameOf(sequence, 15);
  for (WindowObservation& seen : frame.observations) {
    seen.point = {1e307, 1e307};  // finite, but not in units of its standard deviation
  }
  const WindowSummary failed = run.estimator.AddFrame(frame);
  EXPECT_EQ(failed.status.code, StatusCode::kEvaluationFailed);
  EXPECT_NE(failed.status.message.find("the solve failed, and the frame's views are dropped: "),
            std::string::npos)
      << failed.status.message;
  EXPECT_EQ(failed.state.time, frame.time);
  EXPECT_LT(PoseError(failed.state.pose, sequence.frames[15].truth.pose).norm(), 0.1);
  run.next = 16;
  run.Play(40);  // which expects that all goes well
  EXPECT_EQ(run.estimator.num_frames(), 10);
  EXPECT_LT(run.RmsError(), 0.1);
}

// At rest but for a drift whose square is next to zero, seen far out: λ is too large for a double.
// Powers of two, so that no residual is other than zero, and nothing moves before.
TEST(WindowInput, AFrameWhoseLandmarksCannotBeMadeIsSolvedAndSlides) {
  constexpr double kSeconds = 0.125, kDrift = 0x1p-530, kFarOut = -0x1p500;
  SlidingWindowOptions options;
  options.size = 3;
  options.imu.conventions.gravity[2] = 0.0;
  SlidingWindowEstimator estimator(options);
  WindowStart start = GoodStart();
  start.state.velocity[0] = kDrift;
  ASSERT_TRUE(estimator.Start(start, {}).ok());
  const auto frame_at = [&](int i) {
    WindowFrame frame;
    frame.time = i * kSeconds;
    for (int k = -4; k <= 0; ++k) {
      frame.imu.emplace_back().time = frame.time + 0.25 * k * kSeconds;
    }
    return frame;
  };
  const std::int64_t track = 7;
  for (int i = 1; i < 3; ++i) {
    WindowFrame frame = frame_at(i);
    if (i == 2) {
      frame.observations.push_back({track, {0.0, 0.0}});
    }
    const WindowSummary summary = estimator.AddFrame(frame);
    ASSERT_TRUE(summary.status.ok()) << summary.status.message;
    ASSERT_EQ(summary.state.pose[0], i * kSeconds * kDrift);
  }

  WindowFrame frame = frame_at(3);
  frame.observations.push_back({track, {kFarOut, 0.0}});
  const WindowSummary summary = estimator.AddFrame(frame);
  EXPECT_EQ(summary.status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(summary.status.message.find("AddVariable"), std::string::npos)
      << summary.status.message;
  EXPECT_EQ(summary.num_new_landmarks, 0);
  EXPECT_EQ(estimator.LandmarkId(track), -1);
  EXPECT_EQ(summary.state.time, frame.time);
  EXPECT_NE(summary.update.termination, Termination::kFailure) << summary.update.message;
  EXPECT_EQ(summary.left, WindowSummary::Left::kOldest);
  EXPECT_EQ(estimator.num_frames(), 3);
  // The next one comes in as ever.
  EXPECT_TRUE(estimator.AddFrame(frame_at(4)).status.ok());
}

}  // namespace
}  // namespace inceres::test
