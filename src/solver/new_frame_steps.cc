// Steps of frames that have just come, with the landmarks they see, all other frames held.

#include <algorithm>

#include "base/stopwatch.h"
#include "solver/incremental_minimizer.h"

namespace inceres::internal {
namespace {

// They go on while the last gained more than this share of what the first did.
constexpr double kWorthwhileShare = 0.3;

}  // namespace

bool IncrementalMinimizer::TakesNewFrameSteps() {
  system_.TakeNewFrames(&new_frames_);
  return options_.max_new_frame_steps > 0 && !mostly_new_ && shares_.truncation > 0.0 &&
         options_.damping == DampingForm::kHybrid && !new_frames_.empty() &&
         2 * new_frames_.count() <= system_.schur().num_frames() && PartialStep::HasRoomFor(system_.schur(), new_frames_) &&
         !(options_.rebuild == RebuildPolicy::kWhenCheaper && system_.RebuildIsCheaper());
}

// The landmarks seen from a new frame are out of S, for it has brought factors to each of them; here they go in only as far as
// the new frames are concerned, which spares S what would not last.
bool IncrementalMinimizer::FindNewFrameStep() {
  const StageTimer timer(&summary_->solve_seconds);
  LiveSchur& schur = system_.schur();
  active_.Clear();
  new_landmarks_.Grow(schur.landmarks().size());
  new_landmarks_.Clear();
  new_frames_.ForEach([&](std::int32_t frame) {
    for (const std::int32_t landmark : schur.frames()[frame].landmarks) {
      new_landmarks_.Add(landmark);
    }
  });
  const double damping = LandmarkDamping();
  new_landmarks_.ForEach([&](std::int32_t landmark) { schur.PutIntoRows(landmark, damping, new_frames_); });
  damped_anew_ |= reduced_.Refresh(options_.damping, mu_, &schur);
  const bool solved = new_frame_step_.Solve(schur, reduced_, new_frames_);
  for (int k = 0; solved && k < new_frame_step_.num_frames(); ++k) {
    system_.SetFrameStep(new_frame_step_.frame(k), new_frame_step_.step(k));
  }
  new_landmarks_.ForEach([&](std::int32_t landmark) {
    summary_->num_eliminated_landmarks += schur.landmarks()[landmark].partly ? 1 : 0;
    if (solved && schur.landmarks()[landmark].partly) {  // neither held nor parked
      system_.Visit(landmark);
      ++summary_->num_visited_landmarks;
    }
    schur.TakeOutOfRows(landmark, new_frames_);
  });
  trace_->row().num_linear_solver_iterations = 1;
  return solved;
}

// At least one iteration is left to the others. False if the Update ends: with an error, or because the observer says so.
bool IncrementalMinimizer::StepNewFrames(const std::atomic<bool>& stop) {
  double first_gain = 0.0;
  for (int n = 0;
       n < options_.max_new_frame_steps && summary_->num_iterations + 1 < options_.max_num_iterations && !OutOfBudget(stop);
       ++n) {
    if (n > 0 && !LineariseDirty()) {
      return false;
    }
    if (!FindNewFrameStep()) {
      return true;
    }
    ++summary_->num_iterations;
    summary_->num_moved_frames += new_frames_.count();
    double ratio = 0.0;
    const bool evaluated = EvaluateStep(&ratio);
    if (evaluated && trace_->row().predicted_change <= rounding_) {
      trace_->row().step = UpdateStep::kNone;  // they are where they belong
      system_.Reject();
      return EndIteration();
    }
    const bool accepted = evaluated && ratio > options_.min_relative_decrease;
    if (accepted) {
      AcceptStep();
    } else {
      ++summary_->num_rejected_steps;
      system_.Reject();
    }
    const double gain = trace_->row().cost_change;
    if (!EndIteration()) {
      return false;
    }
    first_gain = n == 0 ? gain : first_gain;
    if (!accepted || gain <= std::max(kWorthwhileShare * first_gain, Tolerance())) {
      return true;
    }
  }
  return true;
}

}  // namespace inceres::internal
