#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "inceres/status.h"

namespace inceres {

/// The x for which a chi-square variable of so many degrees of freedom is at most x with this
/// probability: how large ‖U e‖² gets for a measurement that is as good as its information matrix
/// says. Requires 0 < probability < 1 and degrees ≥ 1. Exact to about 12 digits. Source:
/// regularized incomplete gamma function by series and continued fraction (NIST DLMF 8.11.4,
/// 8.9.2), inverted by bisection.
INCERES_EXPORT double ChiSquareQuantile(double probability, int degrees);

/// The robust cost that graduated non-convexity ends with, of s = ‖f‖²/c².
enum class GncKernel {
  kTruncatedLeastSquares,  ///< min(s, 1): what is not an inlier has no influence at all
  kGemanMcClure,           ///< s/(1 + s): what is far has little influence, but never none
};

/// "truncated_least_squares", "geman_mcclure".
INCERES_EXPORT const char* ToString(GncKernel kernel);

/// Gives a weighted problem its start, by setting the graph's values, from the weights of the
/// suspects in their order.
using GncStart = std::function<Status(const std::vector<double>& weights, FactorGraph* graph)>;

/// Options of graduated non-convexity.
struct INCERES_EXPORT GncOptions {
  GncKernel kernel = GncKernel::kTruncatedLeastSquares;  ///< what is minimized in the end
  /// in (0, 1): c² is the chi-square quantile at this probability with as many degrees of freedom
  /// as the factor has residuals. Of right measurements as good as their information says, one
  /// minus this is lost.
  double inlier_probability = 0.99;
  /// > 0: c² is that quantile times this. More than 1 where information matrices promise too much.
  double threshold_scale = 1.0;
  /// Batch: after a first solve with thresholds as above, those of each family of suspects are
  /// multiplied by twice the scale at which the squared errors of its inliers are those of their
  /// distribution (the largest ratio of their quantiles at 50 to 95 %), if that is less than 1, and
  /// all is done anew; until the scale settles. Then thresholds become four times the scale of all
  /// errors that are below the first ones, so that right measurements in the tails come back: wrong
  /// ones are far from there. For information that promises larger errors than there are, as it
  /// does in many files: a wrong loop then costs less than it should. A scale that leaves out more
  /// than a tenth of the inliers is given up. Families with fewer than 20 inliers keep their
  /// thresholds. Takes several times as long. Ignored by LivingGnc, whose first suspects would be
  /// judged by what nothing contradicts yet.
  bool estimate_scale = false;
  /// > 1: the control parameter μ grows (truncated least squares) or falls (Geman–McClure) by this
  /// factor from one weighted problem to the next
  double step = 1.4;
  /// weighted problems at most, ≥ 1, but that one with the last weights is solved in any case; with
  /// estimate_scale: at most for each scale
  int max_rounds = 100;
  /// ≥ 1: steps of one weighted problem, but for the last one, which has solver.max_num_iterations;
  /// of LivingGnc while weights are on the way
  int iterations_a_round = 3;
  /// Batch, if set: gives every weighted problem its start. Where the factors allow for a global
  /// solver or a relaxation (of a pose graph: ChordalStart, io/pose_graph_start.h), a graduation
  /// that begins each problem from it does not stay in the basin where the first, convex problem
  /// has led it. An error ends the solve; in a second look at what was left out, that look alone.
  /// Not set: from where the one before has ended.
  GncStart start;
  /// Batch: of every weighted problem. Ignored by LivingGnc, whose solver has its own.
  SolverOptions solver;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

/// What became of one suspect.
struct GncVerdict {
  FactorId factor;             ///< whose verdict this is
  double squared_error = 0.0;  ///< ‖f‖² at the solution
  double threshold = 0.0;      ///< c²: what an inlier's squared error is below
  double weight = 1.0;         ///< what ½‖f‖² was multiplied by in the last weighted problem
  bool inlier = true;          ///< squared_error ≤ threshold
};

/// One weighted problem.
struct GncRound {
  double mu = 0.0;         ///< the control parameter; 0: before or after the graduation
  double cost = 0.0;       ///< ½ Σ w ‖f‖² and the other factors, after it
  int num_iterations = 0;  ///< of the solver
  /// Factors whose Jacobians LivingGnc's solver evaluated; SolveGnc evaluates all in each
  /// iteration.
  std::int64_t num_relinearized_factors = 0;
  /// factors whose weights LivingGnc has changed before the round, and nothing else
  std::int64_t num_reweighed_factors = 0;
  int num_full = 0;  ///< suspects of weight 1
  int num_none = 0;  ///< suspects of weight 0
};

/// What graduated non-convexity did.
struct INCERES_EXPORT GncSummary {
  /// kConvergence: the weights have settled; kNoConvergence: max_rounds ended it; kFailure: see
  /// `message`
  Termination termination = Termination::kFailure;
  std::string message;               ///< why it ended
  std::vector<GncVerdict> verdicts;  ///< one for each suspect, in the order they were given
  std::vector<GncRound> rounds;      ///< in order
  int num_outliers = 0;              ///< verdicts that are not inliers
  int num_iterations = 0;            ///< of all rounds
  double initial_cost = 0.0;         ///< before the first round, all weights 1
  double final_cost = 0.0;           ///< ½ Σ w ‖f‖² and the other factors
  double seconds = 0.0;              ///< all of it

  /// Whether values and weights are those of a solution.
  bool IsSolutionUsable() const { return IsUsable(termination); }
};

/// Minimizes a graph's cost with a robust cost of the suspects that is non-convex from a start far
/// from the minimum: a sequence of weighted least-squares problems, whose weights come in closed
/// form from the residuals and a control parameter μ, which takes the cost of the suspects from a
/// convex one to that of `kernel`. With s = ‖f‖²/c²:
///
///     truncated least squares: w = 1 for s ≤ μ/(μ + 1), 0 for s ≥ (μ + 1)/μ,
///                              √(μ(μ + 1)/s) − μ between
///     Geman–McClure:           w = (μ/(s + μ))²
///
/// μ begins at 1/(2 s_max − 1), or 2 s_max. At the end of truncated least squares every weight is 0
/// or 1 and agrees with the verdict; then suspects that were left out with errors up to 4, 16, 64
/// and 256 thresholds are tried as inliers, and what costs less is kept: a wrong suspect that was
/// taken for right early keeps right ones out.
///
/// All other factors are *known inliers*, as odometry is: they keep weight and loss. The suspects'
/// own losses are replaced: on a usable solution they are left as ScaledLoss(nullptr, w), so that a
/// solve, a covariance or a file of the graph afterwards has the same cost; null where w is 1.
///
/// kInvalidArgument-like failures (options, a suspect that does not exist or is named twice), and
/// failures of a solve, are told by termination and message, and so is an observer's abort; the
/// graph is then unchanged.
///
/// Cost: a few steps of the batch solver a round, one structure for all, and for each suspect a
/// residual a round. Where many weights have become zero their blocks are left out of the
/// factorization. Threads: as Solve; the result is the same to the last bit for any number. Source:
/// Yang, Antonante, Tzoumas & Carlone, "Graduated non-convexity for robust spatial perception",
/// IEEE RA-L 2020, equations 10 to 14 and remark 5; Black & Rangarajan, IJCV 1996.
INCERES_EXPORT GncSummary SolveGnc(const GncOptions& options, const std::vector<FactorId>& suspects,
                                   FactorGraph* graph);

/// The same on a living graph: one object watches the suspects of an IncrementalSolver, and its
/// Update calls the solver's, round by round, with weights that follow the residuals.
///
/// Every suspect has a history of its own, its μ: it begins when the suspect comes, is begun anew
/// by Reset (which is for a measurement that was edited) and ends when its weight has become 0 or
/// 1. From then on its verdict is looked at again after every round: a settled one that is on the
/// other side of its threshold changes its weight. Between rounds only losses change
/// (GraphEdit::SetLoss), and only those whose weight has changed: what is cached of these factors
/// takes the new weight, and nothing is linearized for it, but where a weight comes back from zero
/// and the factor's variables have moved meanwhile. Only the factors whose variables the solver
/// then moves by enough are linearized; all others keep their Jacobians, and S follows by
/// difference.
///
/// Suspects that come in doubt, up to eight in an Update, weigh nothing until all else is solved
/// for; then IncrementalSolver::Covariance of their variables tells, to first order, what rounds
/// would come to. Where that is plain nothing moves for a wrong suspect, and a right one gets its
/// weight at once; else, of Geman–McClure, and where there is no covariance or a variable would
/// have no place without them, the rounds are taken. Whenever twice as many weigh nothing as the
/// last time, the newest eight of these take rounds again: a wrong one that came before anything
/// contradicted it makes right ones wrong.
///
/// A wrong suspect that comes before any right one contradicts it is taken for right; ResetAll lets
/// all be judged anew, together.
///
/// Threads: as IncrementalSolver. Source: as SolveGnc; histories of single factors: McGann, Rogers
/// & Kaess, "Robust incremental smoothing and mapping (riSAM)", ICRA 2023.
class INCERES_EXPORT LivingGnc {
 public:
  /// Watches suspects of this solver, which must outlive it. What is wrong with the options is told
  /// by Update.
  LivingGnc(const GncOptions& options, IncrementalSolver* solver);
  ~LivingGnc();
  LivingGnc(const LivingGnc&) = delete;
  LivingGnc& operator=(const LivingGnc&) = delete;

  /// From the next Update on the factor may be an outlier, and a loss of its own is replaced, as by
  /// SolveGnc. To be called once its edit is applied.
  void Watch(FactorId factor);
  /// The factor was edited: its history begins anew, as if it had just come, with a weight that
  /// follows from its error then. Others keep theirs. No effect on a factor that is not watched.
  void Reset(FactorId factor);
  /// The same for all of them.
  void ResetAll();
  /// The factor was removed, or is no suspect any more; it keeps the weight it has.
  void Forget(FactorId factor);
  /// Suspects that are watched.
  int num_suspects() const;

  /// IncrementalSolver::Update, then rounds of weights and Updates until no weight changes. In the
  /// steady state, with nothing in doubt, it is the solver's Update and a residual for each
  /// suspect. A suspect that is gone without having been forgotten is a failure that names it.
  GncSummary Update();

 private:
  class INCERES_HIDDEN Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace inceres
