#include "adapters/ceres/session/mode_choice.h"

#include <algorithm>
#include <cstdint>

#include <glog/logging.h>

#include "src/base/formatted.h"

namespace inceres::internal {
namespace {

// In units of an evaluation with Jacobians, what goes with it included. An incremental one also
// renews what is cached of it and its landmark, and a tried step predicts: a third more each.
constexpr double kResiduals = 0.3;
constexpr double kIncrementalJacobians = 1.3;
constexpr double kIncrementalResiduals = 0.4;
constexpr double kBookkeeping = 0.1;  // of a residual block in a session
constexpr double kRow = 1.0;          // of the reduced system, factored

// Work of an incremental solve over that of an exact one with as many iterations. The batch
// solver's share of them is exact mode's.
double WorkRatio(const UpdateSummary& update, const ProblemChanges& changes,
                 const ProblemView& view, int num_frames, bool verified) {
  const double num_factors =
      changes.num_kept_factors + changes.num_replaced_factors + changes.num_added_factors;
  const double num_moving = view.reduced.num_residual_blocks;
  const auto whole_iterations = [num_moving, num_frames](double count) {
    return count * (num_moving * (1.0 + kResiduals) + kRow * num_frames);
  };
  // Of all residual blocks, once each.
  const double in_batch = num_moving * update.num_batch_iterations;
  const auto beside_batch = [in_batch](std::int64_t num_evaluations) {
    return std::max(0.0, static_cast<double>(num_evaluations) - in_batch);
  };
  const double once = kResiduals * (view.all.num_residual_blocks - num_moving);
  const double exact = once + num_moving + whole_iterations(std::max(1, update.num_iterations));
  const double incremental = once + num_factors * (kBookkeeping + (verified ? kResiduals : 0.0)) +
                             whole_iterations(update.num_batch_iterations) +
                             kIncrementalJacobians * beside_batch(update.num_relinearized_factors) +
                             kIncrementalResiduals * beside_batch(update.num_evaluated_factors) +
                             kRow * static_cast<double>(update.num_factored_rows);
  return incremental / exact;
}

}  // namespace

bool ModeChoice::WantsExact() {
  if (num_exact_left_ == 0) {
    return false;
  }
  --num_exact_left_;
  has_paused_ = true;
  return true;
}

void ModeChoice::TellIfAgain() {
  if (has_paused_ && !IsPaused()) {
    has_paused_ = false;
    is_trial_ = true;
    LOG(INFO) << "inceres: auto: incremental again, to see whether it takes less work by now.";
  }
}

void ModeChoice::Note(const UpdateSummary& update, const ProblemChanges& changes,
                      const ProblemView& view, int num_frames, bool verified) {
  if (2 * changes.num_added_factors > changes.num_kept_factors) {
    return;  // mostly new: nothing was remembered yet
  }
  const double ratio = WorkRatio(update, changes, view, num_frames, verified);
  if (ratio <= 1.0) {
    num_losses_ = 0;
    is_trial_ = false;
    return;
  }
  if (++num_losses_ < kLosses && !is_trial_) {
    return;
  }
  reason_ =
      Formatted("auto: incremental solves took %.2f times the work that exact ones would", ratio);
  num_losses_ = 0;
  num_exact_left_ = pause_;
  pause_ *= 2;
  LOG(INFO) << "inceres: " << reason_ << "; the next " << num_exact_left_
            << " solves of this problem are exact.";
}

void ModeChoice::NoteExact(const ceres::Solver::Summary& summary, bool mostly_new) {
  const bool is_quick = summary.termination_type == ceres::CONVERGENCE &&
                        static_cast<int>(summary.iterations.size()) <= kPatience + 1;
  num_quick_ = is_quick ? num_quick_ + 1 : 0;
  num_steady_ = summary.IsSolutionUsable() && !mostly_new ? num_steady_ + 1 : 0;
  is_trial_ = !is_quick;
}

}  // namespace inceres::internal
