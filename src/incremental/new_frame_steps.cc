#include "incremental/new_frame_steps.h"

#include <algorithm>

#include "base/stopwatch.h"

namespace inceres::internal {

// See docs/algorithms.md, "Steps of new frames". With A the new frames and all other frames held,
// S'_AA x_A = b_A is the whole reduced system, where S_AA needs −Y Yᵀ within the rows of A alone.
// Its factor is small, where the full step's would have to follow changes in the rows of all frames
// that the landmarks are seen from. These steps aim at a good start for the full one and not at a
// minimum: they stop as soon as a step gains less than a share of the first one's, or than the
// tolerance. S is left as if they had not been.

bool NewFrameSteps::AreWorthwhile() {
  const IncrementalOptions& options = context_.options;
  const IncrementalSchur& schur = context_.system.schur();
  context_.system.TakeNewFrames(&frames_);
  // Where everything moves, or S is summed anew as a whole, nothing is spared.
  return options.max_new_frame_steps > 0 && !context_.mostly_new &&
         context_.shares.truncation > 0.0 && options.damping == DampingForm::kHybrid &&
         !frames_.empty() && 2 * frames_.count() <= schur.structure().num_frames() &&
         partial_step_.HasRoomFor(schur, frames_) &&
         !(options.rebuild == RebuildPolicy::kWhenCheaper && context_.system.RebuildIsCheaper());
}

// Landmarks seen from a new frame, each once.
void NewFrameSteps::NameLandmarks() {
  const IncrementalSchur& schur = context_.system.schur();
  landmarks_.Grow(schur.landmarks().size());
  landmarks_.Clear();
  frames_.ForEach([&](std::int32_t frame) {
    for (const std::int32_t landmark : schur.frames()[frame].landmarks) {
      landmarks_.Add(landmark);
    }
  });
}

// The landmarks seen from a new frame are out of S, for it has brought factors to each of them;
// here they go in only as far as the new frames are concerned, which spares S what would not last.
bool NewFrameSteps::FindStep() {
  UpdateSummary& summary = *context_.summary;
  const StageTimer timer(&summary.solve_seconds);
  IncrementalSchur& schur = context_.system.schur();
  context_.active.Clear();
  NameLandmarks();
  const double damping = linearization_.LandmarkDamping();
  landmarks_.ForEach([&](std::int32_t landmark) { schur.PutIntoRows(landmark, damping, frames_); });
  // Only vectors: S keeps its old factor.
  frame_step_.Refresh();
  const bool solved = partial_step_.Solve(schur, frame_step_.reduced(), frames_);
  for (int k = 0; solved && k < partial_step_.num_frames(); ++k) {
    context_.system.step().SetFrame(partial_step_.frame(k), partial_step_.step(k));
  }
  // Y and z are still there for the back-substitution; the contribution then leaves the rows of A
  // again, since the full step needs it in all rows.
  landmarks_.ForEach([&](std::int32_t landmark) {
    summary.num_eliminated_landmarks +=
        schur.blocks().state(landmark) == LandmarkState::kInRows ? 1 : 0;
    if (solved && schur.blocks().state(landmark) ==
                      LandmarkState::kInRows) {  // neither held nor undetermined
      context_.system.step().Visit(landmark);
      ++summary.num_visited_landmarks;
    }
    schur.TakeOutOfRows(landmark, frames_);
  });
  context_.row().linear_solver_iterations = 1;
  return solved;
}

// Each step is accepted or refused as any other, but refusals are not answered by damping.
bool NewFrameSteps::Run() {
  const IncrementalOptions& options = context_.options;
  UpdateSummary& summary = *context_.summary;
  TrialStep& step = context_.system.step();
  double first_gain = 0.0;
  for (int n = 0;
       n < options.max_new_frame_steps && summary.num_iterations + 1 < options.max_num_iterations &&
       !context_.OutOfBudget();
       ++n) {
    // For the first step the Update has linearized already.
    if (n > 0 && !linearization_.LinearizeDirty()) {
      return false;
    }
    if (!FindStep()) {
      return true;
    }
    ++summary.num_iterations;
    summary.num_moved_frames += frames_.count();
    double ratio = 0.0;
    const bool evaluated = attempts_.Evaluate(&ratio);
    // A step that promises no more than the cost's rounding proves nothing and cannot be judged.
    if (evaluated && context_.row().model_cost_change <= context_.stop.rounding()) {
      context_.row().step = UpdateStep::kNone;  // they are where they belong
      step.Reject();
      return context_.EndIteration();
    }
    const bool accepted = evaluated && ratio > options.min_relative_decrease;
    if (accepted) {
      attempts_.Accept();
    } else {
      ++summary.num_unsuccessful_steps;
      step.Reject();
    }
    // EndIteration clears the row.
    const double gain = context_.row().cost_change;
    if (!context_.EndIteration()) {
      return false;
    }
    first_gain = n == 0 ? gain : first_gain;
    if (!accepted || gain <= std::max(context_.tuning.new_frames.worthwhile_share * first_gain,
                                      context_.Tolerance())) {
      return true;
    }
  }
  return true;
}

}  // namespace inceres::internal
