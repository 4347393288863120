#pragma once

#include <functional>
#include <vector>

#include <ceres/problem.h>
#include <ceres/solver.h>

#include "adapters/ceres/compare/compare_solves.h"
#include "adapters/ceres/read/user_state.h"

namespace inceres::internal {

/// The caller's options for a solve nobody is to notice: without callbacks and output, with an
/// ordering of its own, which stock edits.
ceres::Solver::Options QuietOptions(const ceres::Solver::Options& options);

/// The options for other linear solvers of stock's that solve the same problem, with the same
/// numbers up to rounding (or, where asked for an iterative one, as closely): none, one or two.
/// `solved` is what stock says of the solve with the caller's options.
std::vector<ceres::Solver::Options> OtherLinearSolvers(const ceres::Solver::Options& quiet,
                                                       const ceres::Solver::Summary& solved);

/// Whether a difference was excused by what the cost functions remember, and not by stock's spread.
bool ExcusedByMemory(const CrossCheckResult& result);

/// Whether there is something to accuse ours of, or it is this comparison's turn.
bool WantsSecondOpinion(const CrossCheckOptions& check, const CrossCheckResult& result);

/// Looks at a comparison that found violations again: are they more than what stock differs by from
/// itself, and are they the solver's at all? Solves from the same start as the two solves that were
/// compared; leaves user memory anyhow.
class SecondOpinion {
 public:
  using SolveAgain = std::function<void(const ceres::Solver::Options&, ceres::Solver::Summary*)>;

  SecondOpinion(const ceres::Solver::Options& options, ceres::Problem* problem,
                const UserState& layout, const SolvedStates& states,
                const JudgedTolerances& tolerances, double factor, const SolveAgain& ours_again);

  /// Moves violations that are excused to result->within_spread; fills result->spread.
  void Judge(CrossCheckResult* result);

 private:
  void SolveWith(const ceres::Solver::Options& other, CrossCheckResult* result);
  void JudgeAnew(CrossCheckResult* result) const;
  bool CostFunctionsRemember(CrossCheckResult* result) const;

  const ceres::Solver::Options quiet_;
  ceres::Problem* const problem_;
  const UserState& layout_;
  const SolvedStates& states_;
  const JudgedTolerances& tolerances_;
  const double factor_;
  const SolveAgain& ours_again_;
  Excuse excuse_;
};

}  // namespace inceres::internal
