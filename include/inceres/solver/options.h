#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/linear/reduced_solver.h"
#include "inceres/solver/callbacks.h"
#include "inceres/status.h"

namespace inceres {

class SolveObserver;
struct FactorId;

/// How a step is chosen, and how far it may go.
enum class TrustRegionStrategyKind {
  /// Nocedal & Wright, section 10.3; radius update of Madsen, Nielsen & Tingleff 2004
  kLevenbergMarquardt,
  /// The same step, with Marquardt's own rule (1963): a tenth of the damping after a step that kept
  /// a fourth of its promise, ten times as much after a refused one; by less once steps are refused
  /// as soon as it falls. Bolder in long valleys, and it passes over no length of steps.
  kMarquardt,
  kDogleg,  ///< Powell's traditional Dog-Leg, Gauss–Newton step regularized by μ when needed
  /// the best step in the plane of gradient and Gauss–Newton step (Byrd, Schnabel & Shultz 1988)
  kSubspaceDogleg,
};

/// "levenberg_marquardt", "marquardt", "dogleg", "subspace_dogleg".
INCERES_EXPORT const char* ToString(TrustRegionStrategyKind kind);

/// Which linear system a step solves.
enum class LinearModelKind {
  /// kSchur if the graph has landmarks, else kPlain; kIterativeSchur where
  /// ReducedSolverKind::kAutomaticInexact predicts that to take less
  kAutomatic,
  kSchur,  ///< landmarks eliminated block by block, reduced system S δ_c = b
  kPlain,  ///< landmarks treated as frames: S = H (pose graphs, curve fitting)
  /// Householder QR of the stacked, scaled Jacobian: does not square the condition number; small
  /// problems only
  kDenseQr,
  /// Landmarks eliminated, S δ_c = b by conjugate gradients, as Ceres's ITERATIVE_SCHUR: for
  /// thousands of frames that many landmarks tie together
  kIterativeSchur,
  /// Landmarks treated as frames, H δ = −g by conjugate gradients, as Ceres's CGNR
  kIterativePlain,
};

/// Whether a linear model's steps come from conjugate gradients.
inline bool IsIterative(LinearModelKind kind) {
  return kind == LinearModelKind::kIterativeSchur || kind == LinearModelKind::kIterativePlain;
}

/// What conjugate gradients are preconditioned by.
enum class PreconditionerKind {
  kIdentity,     ///< nothing
  kJacobi,       ///< the inverses of the diagonal blocks of C + Λ, of H + Λ without landmarks
  kSchurJacobi,  ///< those of S: dearer to make, and fewer iterations
  /// Blocks of S for aggregates of frames that see the same, and a coarse system of how aggregates
  /// move as a whole: translation, rotation, scale. Not of Ceres. Dearer still to make; but on long
  /// paths and in cities it takes tens of iterations where the others take thousands. For
  /// LinearModelKind::kIterativeSchur, S formed or not. Cost: a pass over Y for each of some ten
  /// columns, and a sparse factorization of seven unknowns an aggregate. Source: Konolige & Brown,
  /// "Multigrid for bundle adjustment", 2020.
  kTwoLevel,
  /// Blocks of S within clusters of frames that see the same landmarks; frames are clustered by
  /// ConjugateGradientsOptions::visibility_clustering. For kIterativeSchur, S not formed. Source:
  /// Kushal & Agarwal, "Visibility based preconditioning for bundle adjustment", CVPR 2012.
  kClusterJacobi,
  /// and between clusters that follow each other along paths
  kClusterTridiagonal,
  /// Σ JᵀJ over ConjugateGradientsOptions::subset and Λ, factored sparse: for kIterativePlain where
  /// some of the factors, the odometry of a pose graph say, hold the rest together.
  kSubset,
};

/// How frames are clustered by what they see.
enum class VisibilityClusteringKind {
  kCanonicalViews,  ///< Simon, Snavely & Seitz 2007
  kSingleLinkage,   ///< what similarities of 0.9 or more connect
};

/// How conjugate gradients solve for a step where LinearModelKind asks for them. Names and defaults
/// are Ceres's. They begin at zero; one that takes max_iterations is a step as good as another.
struct INCERES_EXPORT ConjugateGradientsOptions {
  PreconditionerKind preconditioner = PreconditionerKind::kJacobi;  ///< see there
  /// stop when iteration k gains less of the quadratic model's value than this over k; ≥ 0
  double eta = 0.1;
  /// Let the tolerance follow the convergence of the outer loop: after a step that brought the
  /// gradient down to a share q of what it was, in the units of diag(H), stop at min(eta, 0.9 q²),
  /// though not below 0.9 times the square of the last one while that is above 0.1, and at 1e-4 at
  /// the least. Not of Ceres. Source: Eisenstat & Walker, "Choosing the forcing terms in an inexact
  /// Newton method", SIAM J. Sci. Comput. 17(1), 1996, choice 2.
  bool eta_follows_gradient = false;
  int min_iterations = 0;    ///< ≥ 0
  int max_iterations = 500;  ///< ≥ 1, and not below min_iterations
  /// Form S instead of multiplying by its parts: with kSchurJacobi and kTwoLevel only. As in Ceres,
  /// landmarks then stay where they are in a step that took max_iterations.
  bool explicit_schur_complement = false;
  /// Keep the Jacobians of families with more than 4,096 factors in single precision: half their
  /// memory, and products read half as much. With linear_model kIterativeSchur only. Sums are in
  /// double, the gradient is summed before anything is rounded, and costs come from residuals: a
  /// solve converges to the same minimum. Steps, and what they promise to gain, are those of a
  /// Jacobian that is off by 6e-8 of each entry, so that at loose tolerances iterations may differ.
  /// Entries above 3e38 count as infinite.
  bool single_precision_jacobians = false;
  /// of kClusterJacobi and kClusterTridiagonal
  VisibilityClusteringKind visibility_clustering = VisibilityClusteringKind::kCanonicalViews;
  /// of kSubset, which needs it: factors of the graph, each once; another list is another structure
  std::shared_ptr<const std::vector<FactorId>> subset;

  /// Whether all is the same.
  friend bool operator==(const ConjugateGradientsOptions& a, const ConjugateGradientsOptions& b) {
    return a.preconditioner == b.preconditioner && a.eta == b.eta &&
           a.eta_follows_gradient == b.eta_follows_gradient &&
           a.min_iterations == b.min_iterations && a.max_iterations == b.max_iterations &&
           a.explicit_schur_complement == b.explicit_schur_complement &&
           a.single_precision_jacobians == b.single_precision_jacobians &&
           a.visibility_clustering == b.visibility_clustering && a.subset == b.subset;
  }
};

/// Where a line search that has failed at one point tries the next: at half of it, or at the
/// minimum of the polynomial through what is known.
enum class LineSearchInterpolation {
  kBisection,  ///< at half of it
  kQuadratic,  ///< of cost and slope at the start and costs at the last two points
  kCubic,      ///< of costs and slopes at all three: a Jacobian evaluation each
};

/// Options of a batch solve in exact mode. Names, defaults and meanings are those of
/// ceres::Solver::Options 2.1, so a trace can be compared line by line.
struct INCERES_EXPORT SolverOptions {
  /// how steps are chosen
  TrustRegionStrategyKind strategy = TrustRegionStrategyKind::kLevenbergMarquardt;
  LinearModelKind linear_model = LinearModelKind::kAutomatic;  ///< which linear system gives them
  /// how the reduced system is solved
  ReducedSolverKind reduced_solver = ReducedSolverKind::kAutomatic;

  /// If set, makes the solver for S δ_c = b instead of a built-in one.
  ReducedSolverFactory reduced_solver_factory;

  /// Of linear_model kIterativeSchur and kIterativePlain, which use no reduced solver. Where
  /// reduced_solver kAutomaticInexact takes such steps it chooses preconditioner and
  /// explicit_schur_complement; landmarks then follow every step.
  ConjugateGradientsOptions conjugate_gradients;

  /// Find the blocks of the Jacobian that are all zeros at each linearization, and leave them out
  /// of H and its factorization, whose pattern is then made anew whenever the zeros have moved. For
  /// factors that touch many variables of which few count at a time: the points of a curve, a grid
  /// that is looked up. Solution and trace are the same up to rounding; where few blocks are zero
  /// it only costs. Landmarks are treated as frames. With linear_model kAutomatic or kPlain.
  bool dynamic_sparsity = false;

  /// Upper bound on threads, 1 to 1024. With 1 nothing of the user's is ever called concurrently.
  /// The result does not depend on it.
  int num_threads = 1;

  /// Bytes that a solve may take beside the graph, ≥ 0; 0: what the machine, its control groups and
  /// RLIMIT_AS have left when it begins. What Jacobians, plans, the reduced system and its factor
  /// are going to take is counted while the solve is set up, each before it is taken. A solve that
  /// does not fit, not even without keeping Jacobians (recompute_jacobians), or has more of
  /// something than can be numbered, ends there with kFailure and the figures in its message; the
  /// graph is as it was. What losses, families and observers allocate of their own does not count,
  /// nor what a reduced_solver_factory's solver does.
  std::int64_t max_memory_bytes = 0;

  /// Keep no Jacobians but those of some landmarks at a time, and evaluate them anew wherever a
  /// step needs them: three times an iteration instead of once. Costs and steps are the same up to
  /// rounding. By itself a solve does so where it would not fit into memory otherwise
  /// (Summary::recomputed_jacobians tells). With linear_model kAutomatic, kSchur or kPlain, whose
  /// system is then factored; without dynamic_sparsity and refine_landmarks; not with an observer,
  /// bounds, pinned variables, or a family that prepares evaluations.
  bool recompute_jacobians = false;

  int max_num_iterations = 50;              ///< ≥ 0; 0 evaluates the start and returns
  double max_solver_time_in_seconds = 1e9;  ///< ≥ 0; looked at between iterations only
  double function_tolerance = 1e-6;         ///< stop if |ΔF| ≤ function_tolerance · F
  double gradient_tolerance = 1e-10;  ///< stop if max |x − (x ⊞ −g)| ≤ gradient_tolerance
  /// stop if ‖Δx‖ ≤ parameter_tolerance · (‖x‖ + parameter_tolerance)
  double parameter_tolerance = 1e-8;

  /// > 0; for Levenberg–Marquardt 1/radius is the damping
  double initial_trust_region_radius = 1e4;
  double max_trust_region_radius = 1e16;   ///< ≥ min; Levenberg–Marquardt only, as in Ceres
  double min_trust_region_radius = 1e-32;  ///< > 0; stop at or below
  /// accept a step iff (actual decrease) / (predicted decrease) exceeds it
  double min_relative_decrease = 1e-3;
  double min_lm_diagonal = 1e-6;  ///< clamp on the squared column norms of the scaled Jacobian
  double max_lm_diagonal = 1e32;  ///< ≥ min_lm_diagonal; the other end of the clamp
  int max_num_consecutive_invalid_steps = 5;  ///< ≥ 0
  bool jacobi_scaling = true;  ///< scale by 1/(1 + column norm) as measured at iteration 0
  /// accept some increases (Conn, Gould & Toint, section 10.1); the best state is returned
  bool use_nonmonotonic_steps = false;
  int max_consecutive_nonmonotonic_steps = 5;  ///< > 0 if use_nonmonotonic_steps

  /// After steps that creep, gaining more than a fifth of what the step before gained, improve
  /// landmarks one by one, each by one Gauss–Newton step with the frames held: all of them first,
  /// then those that brought the gain, and all again once those gain less than a tenth of what the
  /// step itself does; where all gain less, none after the next step, then after two, four, …
  /// Points seen at a small angle then need a third of the iterations. Leaves landmarks on a
  /// manifold alone. Changes the trace: Ceres's inner iterations minimize each block to the end.
  /// Source: Jeong et al. 2012 (embedded point iterations).
  bool refine_landmarks = false;

  /// Where a robust loss takes away curvature (ρ'' < 0), let H have up to half of it less, in steps
  /// after one that gained less than a hundredth of the cost, until one is refused. Without that,
  /// as in Ceres, H has more curvature than the cost: each step gains 1.3 to 1.7 times what it
  /// promises, and convergence is as much slower. Changes the trace. Source: Triggs et al. 1999,
  /// section 4.3.
  bool reduce_curvature_of_losses = false;

  /// Of graphs with bounds only: each step δ is shortened to t δ until the cost at x ⊞ t δ, clamped
  /// to the bounds, falls by at least line_search_sufficient_function_decrease of what the slope at
  /// 0 promises (Armijo). If no t does, δ is tried as it is.
  LineSearchInterpolation line_search_interpolation = LineSearchInterpolation::kCubic;
  double line_search_sufficient_function_decrease = 1e-4;  ///< between 0 and 1
  /// the next t is at least this share of the last; between 0 and 1
  double max_line_search_step_contraction = 1e-3;
  double min_line_search_step_contraction =
      0.6;                                  ///< and at most this; above the one before, at most 1
  double min_line_search_step_size = 1e-9;  ///< > 0; give up when t max |δ| falls below
  int max_num_line_search_step_size_iterations = 20;  ///< ≥ 0; 0: no line search

  /// Called at evaluations and after iterations; not owned; may be null.
  SolveObserver* observer = nullptr;

  /// If set, is given the table of progress as Ceres prints it, line by line while the solve goes
  /// on: `options.progress = LogTo(std::cout)`. Iteration 0 brings the heading and its row, every
  /// later one its row; one that ends the solve by the function or parameter tolerance has none.
  LogSink progress;
  /// If set, asked after every iteration that has a row: to go on, to end with the best state
  /// (kUserSuccess), or to abort with the state of the start (kUserFailure). After an iteration
  /// come the row of progress, the observer, then this; who ends the solve is the last to be asked.
  ///
  /// What `progress`, `callback` or the observer throws passes through Solve: the graph is then as
  /// before it, and the next solve sets its structure up anew.
  IterationCallback callback;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

}  // namespace inceres
