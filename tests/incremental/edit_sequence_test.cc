// The edit-sequence law: whatever was added, removed, changed, moved, held, relinearized or damped
// anew, in whatever order, S and b are those of a rebuild from the same caches, and the step is
// that of batch.

#include <algorithm>

#include <gtest/gtest.h>

#include "incremental/edit_world.h"

namespace inceres::internal {
namespace {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int kSequencesPerShard = 2;
constexpr int kLongRun = 4000;
#else
constexpr int kSequencesPerShard = 25;
constexpr int kLongRun = 100000;
#endif
constexpr unsigned kShards = 40;
constexpr int kRounds = 15;

void PlayRound(EditWorld* world) {
  world->Edit();
  ASSERT_NO_FATAL_FAILURE(world->StepNewFrames());
  ASSERT_NO_FATAL_FAILURE(world->Relinearize());
  ASSERT_NO_FATAL_FAILURE(world->ExpectLaw()) << "edited";
  ASSERT_NO_FATAL_FAILURE(world->Step());
  ASSERT_NO_FATAL_FAILURE(world->ExpectLaw()) << "moved";
  world->MarkSome();
  ASSERT_NO_FATAL_FAILURE(world->Relinearize());
  ASSERT_NO_FATAL_FAILURE(world->ExpectLaw()) << "relinearised";
}

class EditSequence : public testing::TestWithParam<unsigned> {};

TEST_P(EditSequence, SAndBAndTheStepAreThoseOfARebuild) {
  for (unsigned k = 0; k < kSequencesPerShard; ++k) {
    EditWorldOptions options;
    options.seed = kSequencesPerShard * GetParam() + k;
    options.landmarks = options.seed % 4 != 3;
    options.heavy_priors = options.seed % 2 == 0;
    EditWorld world(options);
    for (int round = 0; round < kRounds; ++round) {
      ASSERT_NO_FATAL_FAILURE(PlayRound(&world))
          << "sequence " << options.seed << ", round " << round;
    }
    ASSERT_NO_FATAL_FAILURE(world.ExpectFreshCost()) << "sequence " << options.seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Shards, EditSequence, testing::Range(0U, kShards));

class LongEditSequence : public testing::TestWithParam<bool> {};

TEST_P(LongEditSequence, HoldsAndKeepsToItsMemory) {
  EditWorldOptions options;
  options.seed = 4711;
  options.heavy_priors = GetParam();
  options.permanent_frame = true;
  EditWorld world(options);
  int num_edits = 0;
  double bytes = 0.0;
  double num_variables = 0.0;
  for (int k = 1; k <= kLongRun; ++k) {
    num_edits += world.Edit() ? 1 : 0;
    if (k % 3 > 0) {  // now and then several edits at once
      ASSERT_NO_FATAL_FAILURE(world.Relinearize());
    }
    if (k % 9 == 1) {
      ASSERT_NO_FATAL_FAILURE(world.Step());
    }
    if (k % 500 == 1 || k == kLongRun) {
      ASSERT_NO_FATAL_FAILURE(world.Relinearize());
      ASSERT_NO_FATAL_FAILURE(world.ExpectLaw()) << "after edit " << k;
    }
    if (k == kLongRun / 4) {
      bytes = static_cast<double>(world.system().Bytes());
      num_variables = world.graph().num_variables();
    }
  }
  ASSERT_NO_FATAL_FAILURE(world.ExpectFreshCost());
  EXPECT_GT(num_edits, 9 * kLongRun / 10);
  // What grows with every edit would have quadrupled since; a largest crowd so far is only seen
  // more and more seldom.
  EXPECT_LT(static_cast<double>(world.system().Bytes()), 1.5 * bytes);
  EXPECT_LT(world.graph().num_variables(), 1.25 * num_variables);
}

INSTANTIATE_TEST_SUITE_P(HeavyPriors, LongEditSequence, testing::Bool());

}  // namespace
}  // namespace inceres::internal
