#pragma once

#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/graph/factor_graph.h"
#include "inceres/solver/summary.h"

namespace inceres {

/// Options of an IncrementalSolver. The thresholds are shares of what function_tolerance allows, spread evenly.
struct INCERES_EXPORT IncrementalOptions {
  int max_num_iterations = 50;  ///< per Update, ≥ 0
  double max_seconds = 1e9;     ///< per Update, > 0, looked at between iterations; the best state so far is kept
  double function_tolerance =
      1e-6;  ///< ≥ 0: an Update ends when a step from fresh Jacobians changes the cost by no more, relative
  double min_relative_decrease = 1e-3;  ///< ≥ 0: accept a step iff (actual decrease) / (predicted decrease) exceeds it
  double initial_damping = 1e-4;        ///< ≥ min_damping: μ at the start of an Update is at most this
  double min_damping = 1e-9;            ///< > 0, for the gauge may be free
  double max_damping = 1e8;             ///< ≥ initial_damping: an Update that needs more ends as a failure to converge

  /// θ_r: between refreshes a factor is relinearised when the squared error of its old linearisation exceeds this share of
  /// function_tolerance · 2F / (number of factors). ≥ 0; 0 relinearises every factor that moved.
  double relinearisation_share = 1.0;
  /// θ_a: a frame stays put when its predicted gain is below this share of function_tolerance · F / (number of frames); a
  /// landmark likewise, unless a frame it is seen from moves. ≥ 0; 0 moves all.
  double truncation_share = 0.1;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

/// What one Update did: counts that do not depend on the machine, and seconds.
struct INCERES_EXPORT UpdateSummary {
  Termination termination = Termination::kFailure;
  std::string message;
  double initial_cost = 0.0;
  double final_cost = 0.0;
  int num_iterations = 0;
  int num_rejected_steps = 0;
  int num_relinearised_factors = 0;
  int num_evaluated_factors = 0;     ///< cost-only, at candidates
  int num_eliminated_landmarks = 0;  ///< taken out of S and put back
  int num_factored_rows = 0;         ///< block rows of the reduced system refactored
  int num_visited_landmarks = 0;     ///< back-substituted
  int num_moved_frames = 0;
  int num_parked_landmarks = 0;  ///< without information at the end
  double seconds = 0.0;
};

/// The solver that remembers: after the first Update, work goes with what changed. Add variables and factors, then Update.
///
/// Levenberg–Marquardt on the reduced system with diag(C) as the metric; a landmark takes up the current damping only when it is
/// re-eliminated, so that a change of damping touches no landmark (algorithms.md sections 2, 3 and 5). A rejected step refreshes
/// old Jacobians before it retreats, and convergence is declared on fresh ones only: old Jacobians defer convergence, they do not
/// replace it.
///
/// Threads: one writer; Update runs on the calling thread. Source: the thesis's algorithms 2–4 as corrected in algorithms.md.
class INCERES_EXPORT IncrementalSolver {
 public:
  explicit IncrementalSolver(const IncrementalOptions& options);
  ~IncrementalSolver();
  IncrementalSolver(const IncrementalSolver&) = delete;
  IncrementalSolver& operator=(const IncrementalSolver&) = delete;

  /// The problem. Variables and factors added to it take part from the next Update on; what is there already must not be changed.
  FactorGraph& graph();
  const FactorGraph& graph() const;

  /// Minimises from the current state. A failure names its factor or variable; what was added since the last Update then takes
  /// part again in the next one, from the values held now.
  UpdateSummary Update();

  /// Current values of a variable: what the last Update found, or what it was added with. (The graph's own state is the start
  /// values.)
  const double* Values(VariableId id) const;
  /// ½ Σ ρ at the current state, as of the last Update.
  double cost() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace inceres
