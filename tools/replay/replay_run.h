#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "inceres/status.h"
#include "tools/replay/replay_solver.h"
#include "tools/replay/replay_step.h"

namespace inceres::tools {

/// What one side did in one step.
struct ReplaySide {
  ReplayOutcome outcome;
  double growth_seconds = 0.0;  ///< AddStep
  /// of its state after the solve: by the judge, or as reported where the judge does not look
  double cost = 0.0;
};

/// One step of a replay. Variables and factors are counted from the start of the replay.
struct ReplayRow {
  int step = 0;  ///< 1, 2, …
  int num_frames = 0;
  int num_landmarks = 0;
  int num_factors = 0;
  bool closes_loop = false;
  ReplaySide ours;
  std::optional<ReplaySide> stock;  ///< absent if stock does not play
  /// The same graph solved from the values ours started the step with, by a solver that does not
  /// remember; absent if none plays along.
  std::optional<ReplayOutcome> batch;
  /// The minimum stock Levenberg–Marquardt reaches from the state ours started the step with;
  /// absent if not asked for or if that solve failed.
  std::optional<double> optimum_cost;

  /// What costs that low are: 1e-16 of the step's initial cost, or residuals of 1e-10 standard
  /// deviations, 1e-20 a factor. A chain of poses along its odometry has no other cost.
  double Rounding() const;

  /// (our cost − optimum) / optimum. Costs below Rounding() count as that.
  std::optional<double> RelativeCostExcess() const;
};

struct ReplayRunOptions {
  int max_steps = 0;  ///< 0: all
  /// fill ReplayRow::optimum_cost: as slow as a cold stock solve each step, not timed
  bool find_optimum = true;
  /// the same after so many steps only, evenly spread, the last among them; 0: after all
  int checkpoints = 0;
  /// the judge looks at the last step at least; not where our weights are our own
  bool look_at_last = true;
};

/// Plays the script to both sides in lockstep: each step both grow, then ours solves, then stock,
/// then the judge looks. Each side goes on from its own state. A solve that fails is in its row and
/// ends nothing; an error is a step that cannot be added. `on_row` is called after each step.
/// `stock` may be null: then, without find_optimum, the judge looks at the last step only, for its
/// evaluation takes the time of the whole problem. `batch`, which may be null and must know
/// StartFrom, solves each step's graph from where ours began.
Status RunReplay(const ReplayScript& script, const ReplayRunOptions& options, ReplaySolver* ours,
                 ReplaySolver* stock, ReplaySolver* batch, ReplayReference* judge,
                 const std::function<void(const ReplayRow&)>& on_row, std::vector<ReplayRow>* rows);

}  // namespace inceres::tools
