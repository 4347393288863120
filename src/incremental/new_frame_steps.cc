// Steps of frames that have just come, with the landmarks they see, all other frames held.

#include <algorithm>

#include "base/stopwatch.h"
#include "incremental/incremental_minimizer.h"

namespace inceres::internal {

// See docs/algorithms.md, "Steps of new frames". With A the new frames and all others held, S'_AA
// x_A = b_A is the whole reduced system, where S_AA needs −Y Yᵀ within the rows of A alone. Its
// factor is small, where the full step's would have to follow changes in the rows of all frames
// that the landmarks are seen from. These steps aim at a good start for the full one and not at a
// minimum: they stop as soon as a step gains less than a share of the first one's, or than the
// tolerance. S is left as if they had not been.

bool IncrementalMinimizer::TakesNewFrameSteps() {
  system_.TakeNewFrames(&new_frames_);
  // Where everything moves, or S is summed anew as a whole, nothing is spared.
  return options_.max_new_frame_steps > 0 && !state_.mostly_new && state_.shares.truncation > 0.0 &&
         options_.damping == DampingForm::kHybrid && !new_frames_.empty() &&
         2 * new_frames_.count() <= system_.schur().structure().num_frames() &&
         new_frame_step_.HasRoomFor(system_.schur(), new_frames_) &&
         !(options_.rebuild == RebuildPolicy::kWhenCheaper && system_.RebuildIsCheaper());
}

// The landmarks seen from a new frame are out of S, for it has brought factors to each of them;
// here they go in only as far as the new frames are concerned, which spares S what would not last.
bool IncrementalMinimizer::FindNewFrameStep() {
  const StageTimer timer(&summary_->solve_seconds);
  IncrementalSchur& schur = system_.schur();
  active_.Clear();
  // Landmarks seen from a new frame, each once.
  new_landmarks_.Grow(schur.landmarks().size());
  new_landmarks_.Clear();
  new_frames_.ForEach([&](std::int32_t frame) {
    for (const std::int32_t landmark : schur.frames()[frame].landmarks) {
      new_landmarks_.Add(landmark);
    }
  });
  const double damping = LandmarkDamping();
  new_landmarks_.ForEach(
      [&](std::int32_t landmark) { schur.PutIntoRows(landmark, damping, new_frames_); });
  // Only vectors: S keeps its old factor.
  frame_step_.Refresh(options_.damping, control_.mu(), &schur);
  const bool solved = new_frame_step_.Solve(schur, frame_step_.reduced(), new_frames_);
  for (int k = 0; solved && k < new_frame_step_.num_frames(); ++k) {
    system_.step().SetFrame(new_frame_step_.frame(k), new_frame_step_.step(k));
  }
  // Y and z are still there for the back-substitution; the contribution then leaves the rows of A
  // again, since the full step needs it in all rows.
  new_landmarks_.ForEach([&](std::int32_t landmark) {
    summary_->num_eliminated_landmarks +=
        schur.blocks().state(landmark) == LandmarkState::kInRows ? 1 : 0;
    if (solved && schur.blocks().state(landmark) ==
                      LandmarkState::kInRows) {  // neither held nor undetermined
      system_.step().Visit(landmark);
      ++summary_->num_visited_landmarks;
    }
    schur.TakeOutOfRows(landmark, new_frames_);
  });
  trace_->row().linear_solver_iterations = 1;
  return solved;
}

// At least one iteration is left to the others. False if the Update ends: with an error, or because
// the observer says so.
bool IncrementalMinimizer::StepNewFrames(const std::atomic<bool>& stop) {
  double first_gain = 0.0;
  for (int n = 0; n < options_.max_new_frame_steps &&
                  summary_->num_iterations + 1 < options_.max_num_iterations && !OutOfBudget(stop);
       ++n) {
    // For the first step the Update has linearized already.
    if (n > 0 && !LinearizeDirty()) {
      return false;
    }
    if (!FindNewFrameStep()) {
      return true;
    }
    ++summary_->num_iterations;
    summary_->num_moved_frames += new_frames_.count();
    double ratio = 0.0;
    const bool evaluated = EvaluateStep(&ratio);
    // A step that promises no more than the cost's rounding proves nothing and cannot be judged.
    if (evaluated && trace_->row().model_cost_change <= stop_.rounding()) {
      trace_->row().step = UpdateStep::kNone;  // they are where they belong
      system_.step().Reject();
      return EndIteration();
    }
    const bool accepted = evaluated && ratio > options_.min_relative_decrease;
    if (accepted) {
      AcceptStep();
    } else {
      ++summary_->num_unsuccessful_steps;
      system_.step().Reject();
    }
    // EndIteration clears the row.
    const double gain = trace_->row().cost_change;
    if (!EndIteration()) {
      return false;
    }
    first_gain = n == 0 ? gain : first_gain;
    if (!accepted ||
        gain <= std::max(tuning_.new_frames.worthwhile_share * first_gain, Tolerance())) {
      return true;
    }
  }
  return true;
}

}  // namespace inceres::internal
