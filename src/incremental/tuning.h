#pragma once

namespace inceres::internal {

/// What steers the steps and the end of an Update, and is no option: thresholds that were found by
/// measuring, with what they are shares of. `tolerance` is IncrementalOptions::function_tolerance
/// times the cost. What each is worth on problems it was not made with is told by
/// benchmarks/ablation.py (docs/tuning.md).
struct Tuning {
  /// When an Update ends.
  struct Stop {
    /// Of the tolerance: the model sees less than this left to gain. Under a robust loss it
    /// undervalues what is left, by a factor of 1.2 to 2 (its Hessian takes ρ'' down to half the
    /// curvature, and of steady factors only).
    double share = 0.08;
    /// The same of a graph without landmarks and without losses: its model is right but for what
    /// curves, and that is little so near the minimum.
    double plain_share = 0.35;
    /// Of the tolerance: what the steps so far let expect of all to come together.
    double rest_share = 0.5;
    /// What the model promises has to fall by more than this factor from one step to the next for
    /// that.
    double steady_factor = 0.5;
    /// From one step to the next that factor may grow so much: if it does by more, a direction
    /// shows in which the model is worse than in those that have been gone.
    double factor_growth = 10.0;
    /// Of the tolerance: no more than this needs no steps that tell how what is left falls.
    double nothing_share = 1e-3;
    /// Of the tolerance: landmarks that together promise more step by themselves before a claim,
    /// which tells how much more than that they could gain.
    double landmarks_share = 1e-3;
    /// Times: what landmarks that were not asked may gain, against what they promise.
    double creeping_landmarks = 16.0;
    /// Iterations that bring less than the tolerance together end an Update.
    int stagnation = 10;
    /// Two dampings that differ by less than this factor are as good as the same. Convergence is
    /// claimed with that of the floor only, for more of it hides what weak directions could gain.
    double fine_damping = 3.0;
  };
  /// When a Jacobian or a weight is renewed.
  struct Relinearize {
    /// Squared error above which a Jacobian is not simply the current one.
    double exact = 1e-20;
    /// Weight of the gradient's error against that of the model.
    double gradient_share = 10.0;
    /// relinearization_share, at most, of what convergence may rest on, and marginalization.
    double refresh_share = 0.1;
    /// Of the tolerance: what old Jacobians may err by, instead of all of it, where a claim rests
    /// on them and landmarks are held by hardly more than damping, or the last step was off.
    double strict_share = 0.03;
    /// Factor by which ρ' may have changed; and where H has half the curvature already, of which a
    /// step may not meet less than a quarter.
    double weight_change = 2.0;
    double corrected_weight_change = 1.4;
    /// Of the worst: a refused step is laid to the old Jacobians of factors whose cost rose so far
    /// above what was predicted.
    double blame_share = 0.1;
  };
  /// What of a step stays undone.
  struct Truncate {
    /// Of what an Update may leave undone: less is always left.
    double floor = 0.1;
    /// The same for a row of S, which is solved anew when its change is worth more (wildfire).
    double wildfire_share = 0.5;
    /// The same for sums that are kept by difference.
    double sum_share = 1e-3;
    /// Of the strongest pull: frames that are pulled at by more join the active set together; less
    /// than the second is no pull.
    double pull_share = 0.2;
    double no_pull = 1e-4;
    /// Scalars of an active set beyond which its factor costs more than what standing still saves.
    int max_scalars = 180;
  };
  /// Landmarks that step by themselves.
  struct Landmarks {
    /// Of what an Update may leave undone: together they could gain more; and of their mean gain,
    /// for each that steps.
    double share = 0.3;
    /// Of what they could gain together: whether convergence can be claimed is asked of landmarks
    /// that could gain more.
    double deciding_share = 0.03;
    /// Of all that is undone: they hold more.
    double dominance = 0.5;
    /// Relative damping, at least: without it a far point, which parallax hardly holds, runs away
    /// along its ray for good.
    double min_damping = 1e-6;
    /// Times that: directions that are less stiff are not looked for behind it.
    double least_seen = 1e-3;
    /// Times today's damping: a landmark damped by more is eliminated anew.
    double outdated_damping = 100.0;
    /// Times the step that its model says: under a robust loss the model of an outlier is too
    /// stiff.
    double max_stretch = 16.0;
  };
  /// What is left after a step, by the factor of S from before it.
  struct EarlierFactor {
    /// Of the promise of that step: it gained as much, give or take this share.
    double kept = 0.1;
    /// Times: what it says is left may be so much more. (On M3500, sphere and city10000 it was at
    /// most 1.6 times as much.)
    double caution = 2.0;
    /// Of the tolerance: it is good for a step where no more is left; and of what was left before
    /// the last step.
    double step_share = 2.0;
    double contraction = 0.1;
    /// Tolerances: it is not asked where the step was off from its promise by more.
    double worth_asking = 20.0;
  };
  /// Steps that are refused, or nearly.
  struct Retreat {
    /// Times ν: growth of the damping when a step is refused. From its floor, doubling would take
    /// long.
    double damping_growth = 10.0;
    /// Gain ratios below which the radius falls to a share of the step's length, and above which it
    /// grows to a multiple of it.
    double poor_ratio = 0.25;
    double good_ratio = 0.75;
    double radius_fall = 0.5;
    double radius_growth = 3.0;
    /// Of a refused step, when it is tried again; and how often that is done.
    double shortening = 0.1;
    int max_shortenings = 1;
    /// Shortened steps in a row after which more damping finds a better direction.
    int max_shortened_in_row = 3;
  };
  /// Steps of frames that have just come.
  struct NewFrames {
    /// Of the first one's gain: they go on while the last gained more.
    double worthwhile_share = 0.3;
  };
  /// What is done anew rather than by difference.
  struct Rebuild {
    /// Of all factors: with more of them new an Update is far from its minimum, and all of it
    /// moves.
    double mostly_new = 0.5;
    /// Times: what replacing a contribution to S costs, against adding it.
    double replace_cost = 1.5;
  };
  /// The batch solver's part of an Update.
  struct Batch {
    /// Of the tolerance: what may be left when its gains fall fast; a gain that is nothing; what
    /// all steps to come may promise.
    double settled_share = 0.1;
    /// Of the tolerance: what may be left where convergence was slow, or steps were refused, and
    /// Marquardt's rule goes on; with a radius of this at least.
    double proof_share = 1e-2;
    double proof_radius = 1e4;
    /// Steps to be taken from that radius, where those before have stagnated.
    int proof_steps = 5;
    double no_gain_share = 1e-3;
    double rest_share = 0.5;
    /// Ratios of gains, twice in a row, that are the end of a fast convergence.
    double fast_ratio = 0.3;
    /// Actual over predicted decrease of a step that tells of the next; and of one that tells of
    /// steps not taken.
    double good_model = 0.5;
    double kept_promise = 0.75;
    /// Of the promise of a step that a claim is tried by, where another solver goes on: its gain
    /// may differ by so much.
    double trial_error = 0.1;
    /// What the model promises has to fall by more than this factor from one step to the next.
    double steady_factor = 0.5;
    /// Tolerances: after a step that kept its promise and gained no more, the next one is hardly
    /// damped.
    double near_gain = 100.0;
    /// Radius of Levenberg–Marquardt, one over its damping, from which on promises and gains tell
    /// of all directions.
    double seeing_radius = 1e8;
    /// Of the tolerance: what damping may hold back of a step that a claim rests on.
    double held_back_share = 0.1;
    /// Norms of columns of J count as this at most where the solve takes its scale of them, at the
    /// start. A camera with a point next to its center has one of 1e15: by that scale its damping
    /// would stay far above its diagonal once the point has gone.
    double most_column_norm = 1e6;
    /// Of the radius at which a step was refused last: up to it steps are taken, as far as is
    /// known.
    double refused_share = 0.1;
    /// Iterations of the strategy that was asked for; what they do not finish Marquardt's rule goes
    /// on with, but for fast descents.
    int patience = 25;
    /// Steps by that rule which together bring less than so many tolerances end an Update.
    int stagnation = 10;
    double stagnation_gain = 1.0;
    /// The same where the damping leaves steps about as long as the model wants them: a flat
    /// valley.
    double free_stagnation_gain = 5.0;
    double free_radius = 1.0;
    /// The same of few steps that bring hardly anything; and of those to be taken as a proof.
    int quick_stagnation = 5;
    double quick_stagnation_gain = 0.2;
    int quick_proof_steps = 3;
    double quick_proof_gain = 0.05;
    /// The same of its iterations, refused steps included: so many try all lengths of steps.
    int stall = 20;
    double stall_gain = 0.25;
    /// Of that rule: with more damping than one over this steps lead nowhere.
    double min_radius = 1e-12;
    /// The same where steps are cut before a border, so that all their lengths have been tried.
    double border_radius = 1e-8;
    /// Of that rule: with less damping than one over this a gauge that nothing holds makes systems
    /// singular.
    double max_radius = 1e10;
    /// Of the initial radius: one that refusals have brought below keeps steps short by itself.
    double shrunk_share = 0.01;
  };

  Stop stop;
  Relinearize relinearize;
  Truncate truncate;
  Landmarks landmarks;
  EarlierFactor earlier_factor;
  Retreat retreat;
  NewFrames new_frames;
  Rebuild rebuild;
  Batch batch;
};

/// What solvers made from now on are steered by: the defaults, unless a test has changed them, or
/// the library was configured with INCERES_TUNING_FROM_ENVIRONMENT, for the ablation, and
/// INCERES_TUNING says "name=value,…". Not to be changed while another thread makes a solver.
Tuning& TuningOfNewSolvers();

}  // namespace inceres::internal
