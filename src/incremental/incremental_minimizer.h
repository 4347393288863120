#pragma once

#include <atomic>
#include <cmath>
#include <cstdint>

#include "inceres/solver/incremental_options.h"
#include "incremental/active_set.h"
#include "incremental/frame_step.h"
#include "incremental/incremental_system.h"
#include "incremental/partial_step.h"
#include "incremental/relinearization.h"
#include "incremental/shares.h"
#include "incremental/step_control.h"
#include "incremental/stopping_rule.h"
#include "incremental/update_trace.h"

namespace inceres::internal {

/// The trust-region loop of the incremental solver: hybrid Levenberg–Marquardt on an
/// IncrementalSystem (docs/algorithms.md, from "One Update of incremental mode" on). What it keeps
/// from one Update to the next is the damping, the factor of S, and the step not taken.
class IncrementalMinimizer {
 public:
  IncrementalMinimizer(const IncrementalOptions& options, const Tuning& tuning,
                       IncrementalSystem* system);

  std::int64_t Bytes() const {
    return frame_step_.Bytes() +
           static_cast<std::int64_t>(active_.Bytes() + new_frame_step_.Bytes());
  }
  /// For the next Minimize; who solves the reduced system stays.
  void SetOptions(const IncrementalOptions& options) { options_ = options; }

  /// Minimizes until what is left undone is below the tolerance, or a limit, `stop` or the trace's
  /// observer says so. On failure the system is incomplete. `mostly_new`: far from the minimum,
  /// where half a step leads elsewhere than a whole one; all of it moves.
  void Minimize(bool mostly_new, const std::atomic<bool>& stop, UpdateTrace* trace);

  /// Where the batch solver was the last to move: linearizes everything, with the least damping of
  /// landmarks.
  Status LinearizeAnew();
  /// And factors S, with that of frames.
  Status FactorizeAnew();
  FrameStep& frame_step() { return frame_step_; }

 private:
  // Says nothing: S is to be factored; little is left; or a step by it does.
  enum class EarlierFactor { kSaysNothing, kLittleLeft, kStep };
  enum class Verdict { kGoOn, kConverged, kStuck, kFailed };
  // Of the Update under way.
  struct UpdateState {
    bool mostly_new = false;
    Shares shares;
    bool landmarks_freed = false;  // since the last step
    bool frames_moved = false;  // since landmarks last stepped by themselves: the frames go first
    double whole_step = -1.0;   // norm of the last step and of what it left out; < 0: none counts
    double left_at_most = HUGE_VAL;    // before the first step, as far as the last Update tells
    double left_before_step = 0.0;     // by the model, of a step that kept its promise; else 0
    int num_landmark_refinements = 0;  // still allowed before the next step of the frames
  };

  bool Begin(bool mostly_new, const std::atomic<bool>& stop);
  bool OutOfBudget(const std::atomic<bool>& stop) const;
  bool EndIteration();
  void Finish(Termination termination, const char* message);

  bool Relinearize();
  bool LinearizeDirty();
  void LookAtReweighed();
  bool Count(const Status& status, const RelinearizeWork& work);
  double LandmarkDamping() const;

  Verdict Iterate();
  bool StepLandmarks();
  double LandmarkGain();
  double Wildfire() const;
  Status FactorizeFrames();
  Status SolveFrames();
  bool SeesLeft(double landmark_gain);
  bool IsLittleLeft(double landmark_gain);
  EarlierFactor AskEarlierFactor();
  double MostLeft() const;
  bool LittleHasCome();
  void NoteStep(double gain_ratio, bool shortened);
  Verdict ClaimConvergence();
  bool FreeHeldLandmarks();
  void SelectActive(double remaining);
  bool TakeStep(bool* refreshed);
  bool EvaluateStep(double* gain_ratio);
  void AcceptStep();
  void Accept(double gain_ratio);
  Verdict Retreat(bool refreshed);
  /// Whether the gradient or the last step is as small as the options ask for (tolerances.cc).
  Verdict JudgeTolerances();
  Verdict JudgeGradient();
  bool IsLastStepShort();
  bool MarkOld();
  double GradientMaxNorm() const;
  double Tolerance() const { return stop_.Tolerance(system_.cost()); }

  bool TakesNewFrameSteps();
  bool FindNewFrameStep();
  bool StepNewFrames(const std::atomic<bool>& stop);

  IncrementalOptions options_;
  const Tuning tuning_;
  IncrementalSystem& system_;
  StepControl control_;
  StoppingRule stop_;
  Relinearization relinearization_;
  UpdateState state_;
  FrameStep frame_step_;
  double factored_mu_ = -1.0;  // of the factor there is
  // What the last Update left undone, and at which cost; infinite: it did not converge.
  double left_ = HUGE_VAL;
  double left_at_cost_ = 0.0;
  ActiveSet active_;
  IndexSet new_frames_;     // since the last Update
  IndexSet new_landmarks_;  // seen from them
  PartialStep new_frame_step_;
  UpdateTrace* trace_ = nullptr;      // of the Minimize under way
  UpdateSummary* summary_ = nullptr;  // the trace's
};

}  // namespace inceres::internal
