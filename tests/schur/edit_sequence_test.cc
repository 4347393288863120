// The edit-sequence law: whatever was added, removed, changed, moved, held, relinearised or damped anew, in whatever order, S and
// b are those of a rebuild from the same caches, and the step is that of batch.

#include <algorithm>

#include <gtest/gtest.h>

#include "schur/edit_world.h"

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
  ASSERT_NO_FATAL_FAILURE(world->Relinearise());
  ASSERT_NO_FATAL_FAILURE(world->ExpectLaw()) << "edited";
  ASSERT_NO_FATAL_FAILURE(world->Step());
  ASSERT_NO_FATAL_FAILURE(world->ExpectLaw()) << "moved";
  world->MarkSome();
  ASSERT_NO_FATAL_FAILURE(world->Relinearise());
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
      ASSERT_NO_FATAL_FAILURE(PlayRound(&world)) << "sequence " << options.seed << ", round " << round;
    }
    ASSERT_NO_FATAL_FAILURE(world.ExpectFreshCost()) << "sequence " << options.seed;
  }
}

INSTANTIATE_TEST_SUITE_P(Shards, EditSequence, testing::Range(0U, kShards));

TEST(EditSequence, HoldsAfterAHundredThousandEdits) {
  EditWorldOptions options;
  options.seed = 4711;
  EditWorld world(options);
  int num_edits = 0;
  std::int64_t bytes = 0;
  std::int64_t variables = 0;
  for (int k = 1; k <= kLongRun; ++k) {
    num_edits += world.Edit() ? 1 : 0;
    if (k % 2 == 0) {  // two edits between relinearisations now and then
      ASSERT_NO_FATAL_FAILURE(world.Relinearise());
    }
    if (k % 8 == 0) {
      ASSERT_NO_FATAL_FAILURE(world.Step());
    }
    if (k % 500 == 0 || k == kLongRun) {
      ASSERT_NO_FATAL_FAILURE(world.ExpectLaw()) << "after edit " << k;
    }
    if (k == kLongRun / 4) {
      bytes = world.system().Bytes();
      variables = world.graph().num_variables();
    }
  }
  ASSERT_NO_FATAL_FAILURE(world.ExpectFreshCost());
  EXPECT_GT(num_edits, 9 * kLongRun / 10);
  EXPECT_LT(world.system().Bytes(), 1.25 * static_cast<double>(bytes));
  EXPECT_LT(world.graph().num_variables(), 1.25 * static_cast<double>(variables));
}

}  // namespace
}  // namespace inceres::internal
