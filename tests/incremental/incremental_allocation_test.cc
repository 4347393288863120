// In the steady state of a sliding window neither Apply nor Update allocates.
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/diagonal_prior.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/incremental_solver.h"
#include "support/allocations.h"
#include "support/random_values.h"
#include "support/test_families.h"

namespace inceres {
namespace {

constexpr int kLandmarksPerFrame = 6;
constexpr int kViews = 6;

// Linear in all but a sine: f_r = x_r + y_r + 0.1 sin(x_r) − m_r. Its measurements allocate
// nothing.
struct View {
  double m[2];
};
class ViewFamily final : public MeasuredFamily<View, AmbientFamily<ViewFamily>> {
 public:
  ViewFamily() : MeasuredFamily(2, {{6, 6}, {3, 3}}) {}
  const char* Name() const override { return "view"; }
  bool EvaluateOne(int i, const double* const* x, double* residuals, double** jacobians) const {
    for (int r = 0; r < 2; ++r) {
      residuals[r] = 0.0;
      for (int s = 0; s < 2; ++s) {
        for (int k = 0; k < slot(s).ambient_size; ++k) {
          const double phase = 1.0 + 7.0 * r + 3.0 * k + s + i % 13;  // of its own for every place
          residuals[r] += std::sin(phase) * x[s][k] + 0.1 * std::sin(x[s][k] + phase);
          if (jacobians != nullptr && jacobians[s] != nullptr) {
            jacobians[s][r * slot(s).ambient_size + k] =
                std::sin(phase) + 0.1 * std::cos(x[s][k] + phase);
          }
        }
      }
      residuals[r] -= measurement(i).m[r];
    }
    return true;
  }
};

// A window of frames, each step one in and one out, with landmarks that are seen from the last few.
class SlidingWindow {
 public:
  SlidingWindow(const IncrementalOptions& options, int num_frames)
      : solver_(options), num_frames_(num_frames), frames_(num_frames), landmarks_(num_frames) {
    // rows of the longest Update there may be, landmark passes between its iterations included
    summary_.iterations.reserve(2 * static_cast<std::size_t>(options.max_num_iterations) + 1);
  }

  void Step() {
    edit_.Restart();
    if (step_ >= num_frames_) {
      edit_.RemoveVariable(frames_[step_ % num_frames_]);
      for (VariableId& landmark : landmarks_[step_ % num_frames_]) {
        edit_.RemoveVariable(landmark);
      }
    }
    const double start[6] = {random_.Unit(), random_.Unit(), random_.Unit(),
                             random_.Unit(), random_.Unit(), random_.Unit()};
    const VariableId frame = frames_[step_ % num_frames_] =
        edit_.AddVariable(start, 6, Role::kFrame);
    const VariableId alone[1] = {frame};
    prior_.mean.assign(start, start + 6);
    priors_->Place(edit_.Connect(prior_family_, alone).index, prior_);
    for (VariableId& landmark : landmarks_[step_ % num_frames_]) {
      landmark = edit_.AddVariable(start, 3, Role::kLandmark);
      for (int v = 0; v < kViews && v <= step_; ++v) {
        const VariableId ids[2] = {frames_[(step_ - v) % num_frames_], landmark};
        if (step_ < num_frames_ || v < num_frames_) {
          views_->Place(edit_.Connect(view_family_, ids, loss_).index,
                        {{random_.Unit(), random_.Unit()}});
        }
      }
    }
    if (step_ > 4) {
      edit_.SetConstant(frames_[(step_ - 3) % num_frames_], step_ % 2 == 0);
      edit_.SetConstant(landmarks_[(step_ - 2) % num_frames_][1], step_ % 3 == 0);
    }
    ++step_;
    const Status status = solver_.Apply(edit_);
    EXPECT_TRUE(status.ok()) << status.message;
  }

  const UpdateSummary& Update() {
    solver_.Update(&summary_);
    return summary_;
  }

 private:
  IncrementalSolver solver_;
  std::shared_ptr<DiagonalPriorFamily> priors_ = std::make_shared<DiagonalPriorFamily>(6);
  std::shared_ptr<ViewFamily> views_ = std::make_shared<ViewFamily>();
  FamilyId prior_family_ = solver_.AddFamily(priors_);
  FamilyId view_family_ = solver_.AddFamily(views_);
  GraphEdit edit_{solver_.graph()};
  std::shared_ptr<const Loss> loss_ = std::make_shared<HuberLoss>(0.5);
  DiagonalPriorFamily::Measurement prior_{{}, std::vector<double>(6, 1.0)};
  test::Random random_{13};
  UpdateSummary summary_;
  int step_ = 0;
  int num_frames_;
  std::vector<VariableId> frames_;
  std::vector<std::array<VariableId, kLandmarksPerFrame>> landmarks_;
};

// How S δ = b is solved, and how many frames the window has: a step of more than 180 unknowns is
// cut off another way.
class IncrementalAllocations : public testing::TestWithParam<std::tuple<ReducedSolverKind, int>> {};

TEST_P(IncrementalAllocations, NothingInASlidingWindow) {
  if (!test::CanCountAllocations()) {
    GTEST_SKIP() << "this build has an allocator of its own";
  }
  IncrementalOptions options;
  const auto [reduced_solver, num_frames] = GetParam();
  options.reduced_solver = reduced_solver;
  options.publish_snapshots = true;  // a copy for other threads costs no memory either
  options.max_num_iterations = 100;
  SlidingWindow window(options, num_frames);
  // Long enough that each way to solve S δ = b that is chosen has been taken before.
  for (int step = 0; step < 250; ++step) {
    window.Step();
    window.Update();
  }
  EXPECT_GT(test::NumAllocations(), 0);  // or the counter counts nothing
  int num_iterations = 0;
  int num_rows = 0;
  for (int step = 0; step < 100; ++step) {
    const test::AllocationTrap trap;
    const std::int64_t before = test::NumAllocations();
    window.Step();
    EXPECT_EQ(test::NumAllocations(), before) << "Apply, step " << step;
    const UpdateSummary& summary = window.Update();
    EXPECT_EQ(test::NumAllocations(), before) << "Update, step " << step;
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    num_iterations += summary.num_iterations;
    num_rows += static_cast<int>(summary.iterations.size());
  }
  EXPECT_GT(num_iterations, 100);
  EXPECT_GT(num_rows, 200) << "the trace is written";
}

INSTANTIATE_TEST_SUITE_P(Solvers, IncrementalAllocations,
                         testing::Combine(testing::Values(ReducedSolverKind::kAutomatic,
                                                          ReducedSolverKind::kResumed,
                                                          ReducedSolverKind::kPcg),
                                          testing::Values(10, 40)));

}  // namespace
}  // namespace inceres
