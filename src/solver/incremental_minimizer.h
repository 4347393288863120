#pragma once

#include <atomic>
#include <cmath>
#include <memory>
#include <vector>

#include "inceres/solver/incremental_options.h"
#include "linear/live_reduced_solver.h"
#include "schur/live_system.h"
#include "solver/active_set.h"
#include "solver/partial_step.h"
#include "solver/reduced_vectors.h"
#include "solver/shares.h"
#include "solver/update_trace.h"

namespace inceres::internal {

/// The trust-region loop of the incremental solver: hybrid Levenberg–Marquardt on a LiveSystem (docs/algorithms.md, from "One
/// Update of incremental mode" on).
/// What it keeps from one Update to the next is the damping, the factor of S, and the step not taken.
class IncrementalMinimizer {
 public:
  IncrementalMinimizer(const IncrementalOptions& options, LiveSystem* system);

  std::int64_t Bytes() const {
    return static_cast<std::int64_t>(solver_->Bytes() + active_.Bytes() + reduced_.Bytes() + new_frame_step_.Bytes() +
                                     sizeof(double) * frame_step_.capacity());
  }
  /// For the next Minimize; who solves the reduced system stays.
  void SetOptions(const IncrementalOptions& options) { options_ = options; }

  /// Minimises until what is left undone is below the tolerance, or a limit, `stop` or the trace's observer says so. On failure
  /// the system is incomplete.
  /// `mostly_new`: far from the minimum, where half a step leads elsewhere than a whole one; all of it moves.
  void Minimize(bool mostly_new, const std::atomic<bool>& stop, UpdateTrace* trace);

 private:
  enum class Verdict { kGoOn, kConverged, kStuck, kFailed };
  struct ErrorLimits {
    double model;
    double squared_gradient;
    bool ExceededBy(const LiveFamily& family, int factor) const {
      return family.SquaredError(factor) > model || family.SquaredGradientError(factor) > squared_gradient;
    }
  };

  bool Relinearise();
  bool LineariseDirty();
  bool Count(const Status& status, const RelineariseWork& work);
  double LandmarkDamping() const;
  bool TakesNewFrameSteps();
  bool FindNewFrameStep();
  bool StepNewFrames(const std::atomic<bool>& stop);
  bool OutOfBudget(const std::atomic<bool>& stop) const;
  bool EndIteration();
  void Finish(Termination termination, const char* message);
  bool StepLandmarks();
  Verdict Iterate();
  Status SolveFrames();
  void TakeStepOff();
  double Wildfire() const;
  double LandmarkGain();
  double Undone();
  bool NextStepsGainLittle(double undone);
  bool HasStagnated();
  double TruncationBudget(double undone) const;
  bool TakeStep(bool* refreshed);
  bool EvaluateStep(double* gain_ratio);
  void AcceptStep();
  void Accept(double gain_ratio);
  void MarkStale();
  bool RefreshAged();
  bool RefreshTouched();
  Verdict Retreat(bool refreshed);
  ErrorLimits LimitsOf(double share) const;
  double Tolerance() const;
  bool IsDampedHard() const;
  Verdict JudgeRefusals();
  bool RelaxDamping();

  IncrementalOptions options_;
  Shares shares_;  // of this Update
  LiveSystem& system_;
  std::unique_ptr<LiveReducedSolver> solver_;
  ActiveSet active_;
  double mu_;
  double nu_ = 2.0;
  double radius_ = HUGE_VAL;      // of the trust region, in the norm ‖Dδ‖; acts after a rejection
  bool mostly_new_ = false;       // this Update began with most factors new
  bool relaxed_ = false;          // μ went to its floor to prove convergence, and no step was taken there since
  double undone_at_floor_ = 0.0;  // what was undone when μ was last near its floor
  double refused_undone_ = 0.0;   // when a step was last refused; HUGE_VAL: not since one was taken near the floor
  double refused_mu_ = 0.0;       // of that step
  bool refused_blindly_ = false;  // a cost function refused to evaluate one of those steps
  int checked_iteration_ = 0;     // from which on HasStagnated counts
  double checked_cost_ = 0.0;     // then
  int num_shortened_ = 0;         // accepted steps in a row that the radius has shortened
  double rounding_ = 0.0;         // of the cost, as this Update began
  bool blamed_few_ = false;       // the last step of the frames failed, and only its worst factors, or none, are linearised anew
  bool frames_moved_ = false;     // since landmarks last stepped by themselves
  int num_landmark_passes_ = 0;   // still allowed before the next step of the frames
  double last_promise_ = 0.0;     // what was undone before the last step of the frames; 0: none, or not all of it was taken
  double last_gain_ratio_ = 1.0;  // of that step
  double landmark_creep_ = 1.0;   // what landmarks gained by themselves, in the last pass, over what they promised; ≥ 1
  ReducedVectors reduced_;
  bool damped_anew_ = false;  // since S was factored: μ or its form is another
  IndexSet new_frames_;       // since the last Update
  IndexSet new_landmarks_;    // seen from them
  PartialStep new_frame_step_;
  std::vector<double> frame_step_;  // packed by block rows, in the form LiveReducedSolver asks for
  std::vector<std::int32_t> changed_rows_;
  std::vector<IndexSet> aged_;        // per family: linearised too long ago to claim convergence on
  UpdateTrace* trace_ = nullptr;      // of the Minimize under way
  UpdateSummary* summary_ = nullptr;  // the trace's
};

}  // namespace inceres::internal
