#pragma once

#include <atomic>
#include <cstdint>

#include "inceres/solver/incremental_options.h"
#include "incremental/claim_in_words.h"
#include "incremental/earlier_factor.h"
#include "incremental/frame_step.h"
#include "incremental/landmark_passes.h"
#include "incremental/new_frame_steps.h"
#include "incremental/step_attempts.h"
#include "incremental/update_context.h"
#include "incremental/update_linearization.h"
#include "incremental/update_tolerances.h"

namespace inceres::internal {

/// The trust-region loop of the incremental solver: hybrid Levenberg–Marquardt on an
/// IncrementalSystem (docs/algorithms.md, from "One Update of incremental mode" on). What it keeps
/// from one Update to the next is the damping, the factor of S, and the step not taken.
class IncrementalMinimizer {
 public:
  IncrementalMinimizer(const IncrementalOptions& options, const Tuning& tuning,
                       IncrementalSystem* system)
      : context_(options, tuning, system) {}
  IncrementalMinimizer(const IncrementalMinimizer&) = delete;
  IncrementalMinimizer& operator=(const IncrementalMinimizer&) = delete;

  std::int64_t Bytes() const {
    return frame_step_.Bytes() +
           static_cast<std::int64_t>(context_.active.Bytes() + new_frames_.Bytes());
  }
  /// For the next Minimize; who solves the reduced system stays.
  /// `claims_hold`: what was claimed by the options of before holds by these.
  void SetOptions(const IncrementalOptions& options, bool claims_hold) {
    context_.options = options;
    if (!claims_hold) {
      earlier_factor_.End(/*converged=*/false);
    }
  }

  /// Minimizes until what is left undone is below the tolerance, or a limit, `stop` or the trace's
  /// observer says so. On failure the system is incomplete. `mostly_new`: far from the minimum,
  /// where half a step leads elsewhere than a whole one; all of it moves.
  void Minimize(bool mostly_new, const std::atomic<bool>& stop, UpdateTrace* trace);

  /// Where the batch solver was the last to move: linearizes everything, with the least damping of
  /// landmarks.
  Status LinearizeAnew() { return linearization_.LinearizeAnew(); }
  /// And factors S, with that of frames.
  Status FactorizeAnew();
  FrameStep& frame_step() { return frame_step_; }

 private:
  enum class Verdict { kGoOn, kConverged, kStuck, kFailed };

  bool Begin();
  bool Run();  // whether it has converged, and the model says what is left
  void FinishConverged();
  Verdict Iterate();
  Verdict FindStep(EarlierFactor::Verdict earlier, double landmark_gain);
  Verdict TakeStep(double remaining);
  Verdict ClaimConvergence();
  double LeftBeyondRounding() const;
  void LookAtStep();
  void NoteDampedSquares();
  double Negligible() const;
  void SelectActive(double remaining);
  void NoteStep(double gain_ratio);
  Verdict Retreat(bool refreshed);

  UpdateContext context_;
  UpdateLinearization linearization_{&context_};
  LandmarkPasses landmarks_{&context_, &linearization_};
  FrameStep frame_step_{&context_};
  StepAttempts attempts_{&context_, &frame_step_};
  EarlierFactor earlier_factor_{&context_, &frame_step_};
  NewFrameSteps new_frames_{&context_, &linearization_, &frame_step_, &attempts_};
  UpdateTolerances tolerances_{&context_, &linearization_};
  bool has_looked_ = false;  // at a step since one was taken
  ClaimInWords words_;  // what a claim of convergence rests on, if not what the model sees left
};

}  // namespace inceres::internal
