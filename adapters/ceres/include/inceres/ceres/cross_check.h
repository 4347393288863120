#pragma once

#include <optional>
#include <string>
#include <vector>

#include <ceres/solver.h>

#include "inceres/export.h"
#include "inceres/status.h"

namespace inceres {

/// One of the two solvers of a comparison.
enum class SolvedBy {
  kOurs,   ///< inceres
  kStock,  ///< Ceres itself
};

/// Asks that stock Ceres solves the same problem from the same start, and that the two results are
/// compared. For a trial run: it takes the time of both.
///
/// Tolerances that are not set are the mode's own. Exact mode follows Ceres's trace, so the
/// defaults are what two correct solvers keep to on a problem that does not amplify rounding.
/// Incremental mode promises only a minimum: ours must not end above stock by more than the
/// function tolerance, and nothing else is judged unless it is set.
struct INCERES_EXPORT CrossCheckOptions {
  bool enabled = false;  ///< whether stock solves, too
  /// Whose result stays in the parameter blocks and in the summary. A solve that the caller's
  /// callback ended stays ours.
  SolvedBy keep = SolvedBy::kOurs;

  /// Largest relative difference of costs, of each iteration and at the end: |a − b| / max(a, b,
  /// ε·initial cost), where ε is the machine's epsilon. Exact 1e-9; incremental
  /// `function_tolerance`, and only upward.
  std::optional<double> cost_tolerance;
  /// Largest difference of a component of a parameter block, relative to the largest magnitude in
  /// its block at the start or the end (1e-3 if all are smaller). Exact 1e-6; incremental not
  /// judged.
  std::optional<double> parameter_tolerance;
  /// Largest difference of the numbers of iterations. Exact 1; incremental not judged. When one
  /// took more iterations than the other within this tolerance, costs may differ by the function
  /// tolerance and parameters by the norms of the steps the other lacks.
  std::optional<int> iteration_tolerance;
  /// Largest relative difference of trust-region radii, as far as rounding does not decide them.
  /// Exact mode only: 1e-6.
  std::optional<double> radius_tolerance;

  /// A problem that amplifies rounding gives two correct solvers two results. So before ours is
  /// accused of a violation, stock solves again from the same start with another linear solver, or
  /// with two others, and ours may differ from stock by this many times what those differ by from
  /// each other; what is excused by it stands in CrossCheckResult::within_spread. 0: any difference
  /// beyond the tolerances is a violation at once.
  ///
  /// If that does not excuse it, ours too solves again, without the caller's callbacks (not in a
  /// CeresSession): when it meets another cost at the very same start, and then agrees with stock,
  /// what differed were the cost functions, which remember.
  double spread_factor = 10.0;
  /// Stock's own spread is also measured where there is nothing to accuse: in one of so many
  /// comparisons of the process; 0: never.
  int spread_interval = 100;

  /// kInvalidArgument, with a message that names the field, if a tolerance is negative or not a
  /// number.
  Status Validate() const;
};

/// The component in which the two solutions differ most, by the measure of
/// CrossCheckOptions::parameter_tolerance.
struct INCERES_EXPORT ParameterDifference {
  /// the address the caller gave to Ceres; null if all parameters are the same to the last bit
  const double* block = nullptr;
  int index = -1;         ///< of the block among Problem::GetParameterBlocks
  int size = 0;           ///< of the block
  int component = -1;     ///< the entry of the block
  double ours = 0.0;      ///< its value where ours ended
  double stock = 0.0;     ///< its value where stock ended
  double relative = 0.0;  ///< |ours − stock| / scale of the block
};

/// What stock's own linear solvers differ by from each other, from the same start; the largest
/// where two were tried.
struct INCERES_EXPORT StockSpread {
  std::string linear_solvers;  ///< "DENSE_SCHUR, SPARSE_SCHUR": the one asked for and the others
  double cost = 0.0;           ///< relative difference of the final costs
  /// relative difference of a parameter, by the measure of CrossCheckOptions::parameter_tolerance
  double parameter = 0.0;
  int iterations = 0;                  ///< difference of their numbers
  int first_different_iteration = -1;  ///< the first one where their traces part; −1 if none
  double seconds = 0.0;                ///< that it took to measure
};

/// What a cross-check found. Both summaries are whole, also of the solve that was not kept.
struct INCERES_EXPORT CrossCheckResult {
  bool compared = false;  ///< both solved it
  /// why not compared, what was left out of the judgment, or that cost functions remember; else
  /// empty
  std::string reason;
  /// each names what differs, both values and the tolerance; empty: they agree
  std::vector<std::string> violations;
  /// What is beyond a tolerance but excused, because stock's own linear solvers differ as much, or
  /// because the cost functions remember, which `reason` then says. Empty if there are violations.
  std::vector<std::string> within_spread;
  std::optional<StockSpread> spread;  ///< if it was measured
  SolvedBy kept = SolvedBy::kOurs;    ///< whose result the caller has
  SolvedBy first = SolvedBy::kOurs;   ///< who solved it first

  ceres::Solver::Summary ours;   ///< of our solve, whichever was kept
  ceres::Solver::Summary stock;  ///< of stock's
  double our_seconds = 0.0;      ///< the whole call without the caller's iteration callbacks
  double stock_seconds = 0.0;    ///< the whole call

  /// (ours − stock) / max(ours, stock, ε·initial cost) of the final costs
  double cost_difference = 0.0;
  ParameterDifference parameters;  ///< where the two ends differ most
  /// the first one beyond tolerance; −1 if none, or if there is no trace to compare
  int first_different_iteration = -1;

  /// Compared, and nothing is beyond what the tolerances and stock's spread allow.
  bool agrees() const { return compared && violations.empty(); }
};

}  // namespace inceres
