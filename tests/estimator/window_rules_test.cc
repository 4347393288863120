// Which frame leaves a window, and what becomes of its landmarks.
#include <algorithm>
#include <limits>
#include <set>
#include <vector>

#include <gtest/gtest.h>

#include "estimator/window_sequence.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/solver/marginalization.h"

namespace inceres::test {
namespace {

using Left = WindowSummary::Left;

// The measurements of the IMU between the frames of the window, oldest first; the family is the
// first one.
std::vector<const ImuPreintegrator*> ImuMeasurements(const SlidingWindowEstimator& estimator) {
  const FactorGraph& graph = estimator.solver().graph();
  const auto& family = dynamic_cast<const ImuFactorFamily&>(graph.family(0));
  std::vector<const ImuPreintegrator*> found;
  for (int i = 0; i + 1 < estimator.num_frames(); ++i) {
    for (int k = 0; k < graph.NumFactors(0); ++k) {
      if (graph.HasFactor(0, k) && graph.Variables(0, k)[0] == estimator.PoseId(i) &&
          graph.Variables(0, k)[2] == estimator.PoseId(i + 1)) {
        found.push_back(&family.measurement(k));
      }
    }
  }
  return found;
}

// They reach from frame to frame without a gap.
void ExpectChain(const SlidingWindowEstimator& estimator) {
  const std::vector<const ImuPreintegrator*> imu = ImuMeasurements(estimator);
  ASSERT_EQ(imu.size(), static_cast<std::size_t>(estimator.num_frames() - 1));
  for (std::size_t i = 0; i < imu.size(); ++i) {
    EXPECT_EQ(imu[i]->samples().front().time, estimator.State(static_cast<int>(i)).time);
    EXPECT_EQ(imu[i]->samples().back().time, estimator.State(static_cast<int>(i) + 1).time);
  }
}

TEST(WindowRules, WithoutAThresholdEveryFrameIsAKeyframe) {
  const VioSequence sequence = Simulate("", 40);
  SlidingWindowOptions options = WindowOptionsOf(sequence);
  options.min_parallax = 0.0;
  WindowRun run(sequence, options);
  run.Play(10);
  EXPECT_EQ(run.summary.left, Left::kNone);
  while (run.next < 40) {
    EXPECT_EQ(run.Step().left, Left::kOldest);
    EXPECT_EQ(run.summary.left_time, sequence.frames[run.next - 11].time);
    ExpectChain(run.estimator);
  }
}

TEST(WindowRules, FramesOfLittleParallaxLeaveAndTheirImuSamplesStay) {
  const VioSequence sequence = Simulate("", 60);
  SlidingWindowOptions options = WindowOptionsOf(sequence);
  options.min_parallax = std::numeric_limits<double>::infinity();
  options.max_imu_seconds = 0.55;  // five intervals of 0.1 s
  WindowRun run(sequence, options);
  int num_oldest = 0, num_second_newest = 0;
  while (run.next < 60) {
    run.Step();
    num_oldest += run.summary.left == Left::kOldest ? 1 : 0;
    if (run.summary.left == Left::kSecondNewest) {
      ++num_second_newest;
      EXPECT_EQ(run.summary.left_time, sequence.frames[run.next - 2].time);
    }
    ExpectChain(run.estimator);
    for (const ImuPreintegrator* imu : ImuMeasurements(run.estimator)) {
      EXPECT_LT(imu->delta().dt, 0.55);
    }
  }
  EXPECT_EQ(num_oldest,
            10);  // of the 50 frames after the tenth, every fifth ends a measurement of 0.5 s
  EXPECT_EQ(num_second_newest, 40);
  EXPECT_LT(run.RmsError(), 0.1);
}

TEST(WindowRules, FewKnownTracksMakeAKeyframe) {
  const VioSequence sequence = Simulate("", 30);
  SlidingWindowOptions options = WindowOptionsOf(sequence);
  options.min_parallax = std::numeric_limits<double>::infinity();
  options.max_imu_seconds = 100.0;
  options.min_tracked = 1'000'000;
  WindowRun run(sequence, options);
  run.Play(30);
  EXPECT_EQ(run.summary.left, Left::kOldest);
  options.min_tracked = 0;
  WindowRun other(sequence, options);
  other.Play(30);
  EXPECT_EQ(other.summary.left, Left::kSecondNewest);
}

// The frames that the prior is about.
std::set<VariableId> InPrior(const WindowRun& run) {
  return {run.summary.marginalization.kept.begin(), run.summary.marginalization.kept.end()};
}

TEST(WindowRules, LandmarksGoWithTheOldestFrameOrMoveOn) {
  const VioSequence sequence = Simulate("", 30);
  SlidingWindowOptions options = WindowOptionsOf(sequence);
  options.min_parallax = 0.0;
  WindowRun vins(sequence, options);
  options.rule = WindowRule::kKeepSeenLandmarks;
  WindowRun okvis(sequence, options);
  vins.Play(10);
  okvis.Play(10);
  // What the oldest frame and the newest one see.
  std::vector<std::int64_t> seen;
  for (const VioObservation& observation : sequence.frames[0].observations) {
    const auto& newest = sequence.frames[10].observations;
    const bool again = std::any_of(newest.begin(), newest.end(), [&](const VioObservation& other) {
      return other.point == observation.point;
    });
    if (again && vins.estimator.LandmarkId(observation.point) >= 0) {
      seen.push_back(observation.point);
    }
  }
  ASSERT_GT(seen.size(), 10u);
  vins.Step();
  okvis.Step();
  for (const std::int64_t track : seen) {
    EXPECT_EQ(vins.estimator.LandmarkId(track), -1);
    EXPECT_GE(okvis.estimator.LandmarkId(track), 0);
  }
  EXPECT_GE(okvis.summary.num_reanchored_landmarks,
            static_cast<int>(seen.size()));  // some are new with the last frame
  EXPECT_GT(okvis.summary.num_marginalized_landmarks, 0);
  EXPECT_GT(vins.summary.num_marginalized_landmarks, okvis.summary.num_marginalized_landmarks);
  EXPECT_EQ(InPrior(vins).count(vins.estimator.PoseId(9)), 1u)
      << "tied to what the oldest saw by the landmarks they share";
  EXPECT_EQ(InPrior(okvis).count(okvis.estimator.PoseId(9)), 0u)
      << "its landmarks were kept out of the prior";
}

// A view is in the prior or in the graph, never in both: with all landmarks gone, the tracks start
// anew.
TEST(WindowRules, NoViewIsUsedTwice) {
  const VioSequence sequence = Simulate("", 12);
  SlidingWindowOptions options = WindowOptionsOf(sequence);
  options.min_parallax = 0.0;
  WindowRun run(sequence, options);
  run.Play(10);
  std::vector<std::int64_t> old_tracks;
  for (const VioObservation& observation : sequence.frames[0].observations) {
    if (run.estimator.LandmarkId(observation.point) >= 0) {
      old_tracks.push_back(observation.point);
    }
  }
  run.Step();
  ASSERT_FALSE(old_tracks.empty());
  run.Step();
  for (const std::int64_t track : old_tracks) {
    EXPECT_EQ(run.estimator.LandmarkId(track), -1) << "one view since, of track " << track;
  }
}

TEST(WindowRules, FirstEstimatesArePinnedOnlyIfAskedFor) {
  const VioSequence sequence = Simulate("", 14);
  SlidingWindowOptions options = WindowOptionsOf(sequence);
  options.min_parallax = 0.0;
  WindowRun plain(sequence, options);
  plain.Play(14);
  EXPECT_FALSE(plain.estimator.solver().graph().HasPins());
  options.marginalization.first_estimate_jacobians = true;
  WindowRun pinned(sequence, options);
  pinned.Play(14);
  for (const VariableId id : pinned.summary.marginalization.kept) {
    EXPECT_NE(pinned.estimator.solver().graph().PinnedValues(id), nullptr);
  }
}

}  // namespace
}  // namespace inceres::test
