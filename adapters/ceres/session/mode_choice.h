#pragma once

#include <algorithm>
#include <string>

#include <ceres/solver.h>

#include "adapters/ceres/read/introspection.h"
#include "inceres/ceres/solve.h"
#include "inceres/solver/update_summary.h"

namespace inceres::internal {

/// Learns from the solves of a living problem whether to remember is worth it. Work is counted, not
/// timed, so that a program does the same whenever it runs: evaluations of residual blocks, those
/// with Jacobians as units, and rows of the reduced system.
///
/// An incremental solve tells both sides: what it did itself, and by its iterations what an exact
/// one would have done, for that evaluates everything in each that touches a variable block, and
/// once, as the incremental one does, what touches none. After kLosses solves in a row that
/// cost more than exact ones the next are exact, first kPause of them, each time it comes to the
/// same twice as many; then it is tried again by one solve.
///
/// To begin to remember takes one linearization of everything. It is worth it where solves end soon
/// after what comes in between, or that is little: of kInARow exact ones in a row each has
/// converged within kPatience iterations, or each had at most twice as many residual blocks
/// as the one before. After one that took longer a first loss is enough to give up again: what
/// incremental steps do not end in as many, others do anew.
class ModeChoice {
 public:
  static constexpr int kLosses = 3;
  static constexpr int kPause = 4;
  static constexpr int kInARow = 2;
  /// Iterations after which incremental steps are given up for a solve: those that converge mostly
  /// take fewer than ten.
  static constexpr int kPatience = 25;

  /// Whether the next solve should be exact. Call once a solve.
  bool WantsExact();
  /// Whether it will say so of the next: solves are exact for what incremental ones took.
  bool IsPaused() const { return num_exact_left_ > 0; }
  /// Call where an incremental solve begins: tells the log of the first after such a pause.
  void TellIfAgain();
  /// What an incremental solve of the problem viewed took. `verified`: each residual block that
  /// stayed was evaluated to be recognized.
  void Note(const UpdateSummary& update, const ProblemChanges& changes, const ProblemView& view,
            int num_frames, bool verified);
  /// How an exact solve went. `mostly_new`: most of its residual blocks have come since the last.
  void NoteExact(const ceres::Solver::Summary& summary, bool mostly_new);
  /// Whether what the last exact solve has found is to be remembered.
  bool IsToRemember() const { return std::max(num_quick_, num_steady_) >= kInARow; }
  /// Why solves are exact now.
  const std::string& reason() const { return reason_; }

 private:
  int num_losses_ = 0;
  int num_quick_ = 0;
  int num_steady_ = 0;
  // after a pause, or a last exact solve that was long: no incremental one has won since
  bool is_trial_ = false;
  int pause_ = kPause;
  int num_exact_left_ = 0;
  bool has_paused_ = false;  // since the last incremental solve
  std::string reason_;
};

}  // namespace inceres::internal
