#pragma once

#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "inceres/status.h"
#include "tools/ab/statistics.h"
#include "tools/solve/run_solver.h"

namespace inceres::tools {

/// One of the solvers under comparison. `run` solves the problem once from the start; with a limit
/// it stops after that many iterations if the settings do not stop it sooner.
struct Contender {
  std::string solver;         ///< "inceres" or "ceres"
  std::string configuration;  ///< "dense_schur_points_first"
  std::function<Status(std::optional<int> iteration_limit, RunOutcome* outcome)> run;
};

/// All rounds of one contender.
struct ContenderRuns {
  std::string solver;
  std::string configuration;
  std::vector<SolveRecord> rounds;
  std::vector<double> parameters;  ///< of the first round

  const SolveRecord& first() const { return rounds.front(); }
  Spread Seconds() const;
  /// Largest − smallest final cost over the rounds: zero for a solver whose result is the same
  /// every time.
  double FinalCostSpread() const;
  /// Median seconds of one iteration, the share of the set-up included.
  double SecondsPerIteration() const;
  /// Median seconds of each stage, in the solver's own names and order, as the first round has
  /// them.
  std::vector<std::pair<std::string, double>> StageSeconds() const;
};

/// A contender that was taken out, and why.
struct Dropped {
  std::string configuration;
  std::string reason;
};

/// Everything measured.
struct AbResult {
  ContenderRuns ours;
  std::vector<ContenderRuns> stock;
  std::vector<Dropped> dropped;

  const ContenderRuns& FastestStock() const;  ///< lowest median
  double LowestStockCost() const;             ///< lowest final cost of the stock runs
  double LowestCost() const;                  ///< of all
  /// Ours against these runs, round by round.
  Spread RatioTo(const ContenderRuns& theirs) const;
  /// The same against the fastest stock.
  Spread RatioToBestStock() const { return RatioTo(FastestStock()); }
  /// (our final cost − lowest stock final cost) / lowest stock final cost. Costs below 1e-16 of the
  /// initial cost are rounding and count as that.
  double RelativeCostDifference() const;
};

struct AbOptions {
  int repeats = 11;
  bool drop_slow = true;  ///< whether the pre-pass takes out hopelessly slow stock configurations
  double hopeless_factor = 2.5;  ///< slower than the best by more than this is hopeless
  int pre_pass_iterations = 3;
};

/// The protocol: a pre-pass of a few iterations of everyone, which warms up, finds a shim that
/// falls back to stock, and drops hopeless stock configurations; then `repeats` rounds ours, stock
/// A, stock B, …, interleaved so that drifts of the machine hit all alike. Each call is a first
/// one: what ours remembers of a problem's structure is forgotten before. `announce` is told what
/// happens, a line at a time. Errors: ours does not solve the problem, no stock configuration does,
/// or the shim used stock Ceres (kUnavailable).
Status RunComparison(const Contender& ours, const std::vector<Contender>& stock,
                     const AbOptions& options,
                     const std::function<void(const std::string&)>& announce, AbResult* result);

}  // namespace inceres::tools
