// The step of some frames while all others stay: right against a dense oracle, and few frames where
// the pull is local.

#include "incremental/partial_step.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "incremental/active_set.h"
#include "incremental/incremental_system.h"
#include "incremental/whole_graph.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::BundleOptions;
using test::MakeBundle;
using test::RandomGraph;

constexpr double kMu = 1e-3;

// S' of an incremental system with damping mu · diag(C), b, and what the free frames have to gain,
// as dense matrices.
class Reduced {
 public:
  explicit Reduced(RandomGraph* graph) : system_(graph->graph(), 1) { AddWholeGraph(&system_); }

  void Linearize() {
    RelinearizeWork work;
    ASSERT_TRUE(system_.Relinearize(kMu, RebuildPolicy::kAlways, &work).ok());
    const IncrementalSchur& schur = system_.schur();
    S_ = Eigen::MatrixXd::Zero(schur.size(), schur.size());
    b_.resize(schur.size());
    for (int i = 0; i < static_cast<int>(schur.frames().size()); ++i) {
      const int size = schur.frames()[i].size;
      for (const SymmetricBlockRows::Entry& entry : schur.S().row(i)) {
        const int columns = schur.S().size_of(entry.column);
        for (int r = 0; r < size; ++r) {
          for (int c = 0; c < columns; ++c) {
            const double value = schur.S().values(entry.offset)[r * PadToQuad(columns) + c];
            S_(schur.FrameOffset(i) + r, schur.FrameOffset(entry.column) + c) = value;
            S_(schur.FrameOffset(entry.column) + c, schur.FrameOffset(i) + r) = value;
          }
        }
      }
      for (int k = 0; k < size; ++k) {
        S_(schur.FrameOffset(i) + k, schur.FrameOffset(i) + k) += kMu * schur.FrameDiagonal(i)[k];
        b_[schur.FrameOffset(i) + k] = schur.b(i)[k];
      }
    }
    vectors_.Refresh(DampingForm::kHybrid, kMu, &system_.schur());
  }

  // x_A and the gain of these frames, all others held.
  double Gain(const std::vector<int>& frames, Eigen::VectorXd* step) const {
    std::vector<int> scalars;
    for (const int frame : frames) {
      for (int k = 0; k < schur().frames()[frame].size; ++k) {
        scalars.push_back(schur().FrameOffset(frame) + k);
      }
    }
    const Eigen::VectorXd b = b_(scalars);
    *step = S_(scalars, scalars).ldlt().solve(b);
    return 0.5 * b.dot(*step);
  }

  double WholeGain() const {
    std::vector<int> free;
    for (int i = 0; i < static_cast<int>(schur().frames().size()); ++i) {
      if (!schur().frames()[i].held) {
        free.push_back(i);
      }
    }
    Eigen::VectorXd step;
    return Gain(free, &step);
  }

  const IncrementalSchur& schur() const { return system_.schur(); }
  IncrementalSchur& schur() { return system_.schur(); }
  const ReducedVectors& vectors() const { return vectors_; }
  IncrementalSystem& system() { return system_; }

 private:
  IncrementalSystem system_;
  Eigen::MatrixXd S_;
  Eigen::VectorXd b_;
  ReducedVectors vectors_;
};

std::vector<int> FramesOf(const PartialStep& partial) {
  std::vector<int> frames;
  for (int k = 0; k < partial.num_frames(); ++k) {
    frames.push_back(partial.frame(k));
  }
  return frames;
}

void ExpectStep(const Reduced& reduced, const PartialStep& partial, double asked) {
  const std::vector<int> frames = FramesOf(partial);
  Eigen::VectorXd expected;
  EXPECT_GE(reduced.Gain(frames, &expected), asked * (1.0 - 1e-10));
  int at = 0;
  for (int k = 0; k < partial.num_frames(); ++k) {
    EXPECT_FALSE(reduced.schur().frames()[frames[k]].held);
    for (int c = 0; c < reduced.schur().frames()[frames[k]].size; ++c, ++at) {
      EXPECT_NEAR(partial.step(k)[c], expected[at], 1e-10 * expected.norm());
    }
  }
}

TEST(PartialStep, IsThatOfTheFramesItTakesAndGainsWhatIsAsked) {
  PartialStep partial{Tuning::Truncate()};  // as in its use, the same for all
  for (unsigned seed = 1; seed <= 10; ++seed) {
    BundleOptions options;
    options.seed = seed;
    options.num_frames = 20;
    options.num_landmarks = 60;
    options.frame_sizes = {6, 3, 7};
    options.hosted = seed % 2 == 0;
    const std::unique_ptr<RandomGraph> graph = MakeBundle(options);
    Reduced reduced(graph.get());
    reduced.schur().HoldFrame(static_cast<int>(seed), true);
    ASSERT_NO_FATAL_FAILURE(reduced.Linearize());
    const double whole = reduced.WholeGain();
    int num_before = 0;
    for (const double share : {0.3, 0.9, 0.97, 0.9999}) {
      ASSERT_TRUE(partial.Find(reduced.schur(), reduced.vectors(), share * whole))
          << seed << ": " << share;
      ExpectStep(reduced, partial, share * whole);
      EXPECT_GE(partial.num_frames(), num_before);
      num_before = partial.num_frames();
    }
  }
}

TEST(PartialStep, TakesNoFrameWhereNothingIsAskedAndFailsWhereTooMuchIs) {
  const std::unique_ptr<RandomGraph> graph = MakeBundle(BundleOptions());
  Reduced reduced(graph.get());
  ASSERT_NO_FATAL_FAILURE(reduced.Linearize());
  PartialStep partial{Tuning::Truncate()};
  EXPECT_TRUE(partial.Find(reduced.schur(), reduced.vectors(), 0.0));
  EXPECT_EQ(partial.num_frames(), 0);
  EXPECT_FALSE(partial.Find(reduced.schur(), reduced.vectors(), 1.01 * reduced.WholeGain()));
}

TEST(PartialStep, StopsWhereTheFactorWouldGrowTooLarge) {
  BundleOptions options;
  options.num_frames = 60;
  options.num_landmarks = 120;
  const std::unique_ptr<RandomGraph> graph = MakeBundle(options);
  Reduced reduced(graph.get());
  ASSERT_NO_FATAL_FAILURE(reduced.Linearize());
  PartialStep partial{Tuning::Truncate()};
  EXPECT_FALSE(
      partial.Find(reduced.schur(), reduced.vectors(), (1.0 - 1e-12) * reduced.WholeGain()));
}

// A chain at rest but for its last link: the frames near it make the step.
TEST(PartialStep, TakesFewFramesWhereThePullIsLocal) {
  constexpr int kFrames = 40;
  RandomGraph graph(5);
  std::vector<VariableId> frames;
  for (int i = 0; i < kFrames; ++i) {
    frames.push_back(graph.AddFrame(3));
    graph.Connect(3, {frames.back()}, nullptr, 0.0);
    if (i > 0) {
      graph.Connect(3, {frames[i - 1], frames[i]}, nullptr, i + 1 == kFrames ? 0.5 : 0.0);
    }
  }
  Reduced reduced(&graph);
  ASSERT_NO_FATAL_FAILURE(reduced.Linearize());
  PartialStep partial{Tuning::Truncate()};
  const double asked = 0.97 * reduced.WholeGain();
  ASSERT_TRUE(partial.Find(reduced.schur(), reduced.vectors(), asked));
  ExpectStep(reduced, partial, asked);
  EXPECT_LE(partial.num_frames(), kFrames / 4);
  const std::vector<int> taken = FramesOf(partial);
  EXPECT_GE(*std::min_element(taken.begin(), taken.end()), kFrames / 2);
}

// With a budget for all of the step, but for the frame whose step is no number: that one cannot be
// ranked, and is the only one to move, so that the evaluation refuses the step.
TEST(ActiveSet, AFrameWhoseGainIsNoNumberMovesAndMixesUpNoOther) {
  for (const int odd : {0, 7, 19}) {
    BundleOptions options;
    options.num_frames = 20;
    options.num_landmarks = 60;
    const std::unique_ptr<RandomGraph> graph = MakeBundle(options);
    Reduced reduced(graph.get());
    ASSERT_NO_FATAL_FAILURE(reduced.Linearize());
    std::vector<double> frame_step(static_cast<std::size_t>(reduced.schur().size()), 1e-3);
    frame_step[static_cast<std::size_t>(reduced.schur().FrameOffset(odd))] =
        std::numeric_limits<double>::quiet_NaN();
    ActiveSet active{Tuning::Truncate()};
    ReducedSolver::Rows all;
    all.first_row = 0;
    ActiveSet::Limits limits;
    limits.remaining_decrease = 1e6;
    limits.negligible = 0.0;
    limits.frame_gain = HUGE_VAL;  // no few frames gain that
    active.Select(frame_step, reduced.vectors(), all, limits, &reduced.system());
    EXPECT_EQ(active.frames(), std::vector<std::int32_t>{odd});
  }
}

}  // namespace
}  // namespace inceres::internal
