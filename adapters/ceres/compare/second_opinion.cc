#include "adapters/ceres/compare/second_opinion.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <sstream>
#include <utility>

#include <ceres/types.h>

#include "adapters/ceres/fallback/gate.h"
#include "src/base/stopwatch.h"

namespace inceres::internal {
namespace {

using Options = ceres::Solver::Options;

// The first words of CrossCheckResult::reason where that excuses a difference.
constexpr char kTheyRemember[] = "the cost functions remember earlier calls";

// A dense solver for what a sparse one was asked for takes no longer up to about here.
constexpr int kMaxDenseSize = 1000;

bool HaveSparse(Options* options) {
  for (const auto library :
       {options->sparse_linear_algebra_library_type, ceres::SUITE_SPARSE, ceres::EIGEN_SPARSE}) {
    if (library != ceres::NO_SPARSE && ceres::IsSparseLinearAlgebraLibraryTypeAvailable(library)) {
      options->sparse_linear_algebra_library_type = library;
      return true;
    }
  }
  return false;
}

std::vector<ceres::LinearSolverType> OtherTypes(ceres::LinearSolverType type, bool small) {
  switch (type) {
    case ceres::DENSE_SCHUR:
      return {ceres::SPARSE_SCHUR, ceres::SPARSE_NORMAL_CHOLESKY};
    case ceres::DENSE_NORMAL_CHOLESKY:
      return {ceres::SPARSE_NORMAL_CHOLESKY, ceres::SPARSE_SCHUR};
    case ceres::SPARSE_SCHUR:
      return small ? std::vector<ceres::LinearSolverType>{ceres::SPARSE_NORMAL_CHOLESKY,
                                                          ceres::DENSE_SCHUR}
                   : std::vector<ceres::LinearSolverType>{ceres::SPARSE_NORMAL_CHOLESKY};
    case ceres::SPARSE_NORMAL_CHOLESKY:
      return small ? std::vector<ceres::LinearSolverType>{ceres::SPARSE_SCHUR,
                                                          ceres::DENSE_NORMAL_CHOLESKY}
                   : std::vector<ceres::LinearSolverType>{ceres::SPARSE_SCHUR};
    default:
      return {};
  }
}

// Normal equations are no measure of a QR factorization, which is there because they lose digits:
// another one is.
std::vector<Options> OtherLibrary(const Options& quiet) {
  Options other = quiet;
  other.dense_linear_algebra_library_type =
      quiet.dense_linear_algebra_library_type == ceres::EIGEN ? ceres::LAPACK : ceres::EIGEN;
  const bool available =
      ceres::IsDenseLinearAlgebraLibraryTypeAvailable(other.dense_linear_algebra_library_type);
  return available ? std::vector<Options>{other} : std::vector<Options>();
}

Options OtherPreconditioner(const Options& quiet, ceres::LinearSolverType type) {
  Options other = quiet;
  const ceres::PreconditionerType second =
      type == ceres::CGNR ? ceres::IDENTITY : ceres::SCHUR_JACOBI;
  other.preconditioner_type = quiet.preconditioner_type == ceres::JACOBI ? second : ceres::JACOBI;
  return other;
}

std::string Excused(double first, double again) {
  std::ostringstream text;
  text.precision(12);
  text << kTheyRemember << ": at the same start the cost was " << first << ", then " << again
       << "; with what they remember now, ours and stock agree";
  return text.str();
}

}  // namespace

std::vector<Options> OtherLinearSolvers(const Options& quiet,
                                        const ceres::Solver::Summary& solved) {
  const ceres::LinearSolverType type = solved.linear_solver_type_used;
  if (type == ceres::DENSE_QR) {
    return OtherLibrary(quiet);
  }
  if (type == ceres::ITERATIVE_SCHUR || type == ceres::CGNR) {
    return {OtherPreconditioner(quiet, type)};
  }
  std::vector<Options> others;
  for (const ceres::LinearSolverType other_type :
       OtherTypes(type, solved.num_effective_parameters_reduced <= kMaxDenseSize)) {
    Options other = quiet;
    other.linear_solver_type = other_type;
    other.dynamic_sparsity = false;
    other.use_mixed_precision_solves = false;
    if (!ceres::IsSchurType(type) || !ceres::IsSchurType(other_type)) {
      other.linear_solver_ordering = nullptr;  // its groups are for the other kind
    }
    const bool sparse =
        other_type == ceres::SPARSE_SCHUR || other_type == ceres::SPARSE_NORMAL_CHOLESKY;
    if (!sparse || HaveSparse(&other)) {
      others.push_back(std::move(other));
    }
  }
  return others;
}

Options QuietOptions(const Options& options) {
  Options quiet = options;
  quiet.callbacks.clear();
  quiet.minimizer_progress_to_stdout = false;
  quiet.logging_type = ceres::SILENT;
  quiet.trust_region_minimizer_iterations_to_dump.clear();
  for (auto* ordering : {&quiet.linear_solver_ordering, &quiet.inner_iteration_ordering}) {
    if (*ordering != nullptr) {
      *ordering = std::make_shared<ceres::ParameterBlockOrdering>(**ordering);
    }
  }
  return quiet;
}

bool ExcusedByMemory(const CrossCheckResult& result) {
  return result.reason.rfind(kTheyRemember, 0) == 0;
}

bool WantsSecondOpinion(const CrossCheckOptions& check, const CrossCheckResult& result) {
  static std::atomic<std::uint64_t> num_comparisons{0};
  const std::uint64_t number = ++num_comparisons;
  if (check.spread_factor <= 0.0) {
    return false;
  }
  return !result.violations.empty() ||
         (check.spread_interval > 0 &&
          number % static_cast<std::uint64_t>(check.spread_interval) == 0);
}

SecondOpinion::SecondOpinion(const Options& options, ceres::Problem* problem,
                             const UserState& layout, const SolvedStates& states,
                             const JudgedTolerances& tolerances, double factor,
                             const SolveAgain& ours_again)
    : quiet_(QuietOptions(options)),
      problem_(problem),
      layout_(layout),
      states_(states),
      tolerances_(tolerances),
      factor_(factor),
      ours_again_(ours_again) {
}

void SecondOpinion::Judge(CrossCheckResult* result) {
  std::vector<std::string> suspected = result->violations;
  for (const Options& other : OtherLinearSolvers(quiet_, result->stock)) {
    SolveWith(other, result);
    JudgeAnew(result);
    if (result->violations.empty()) {
      break;
    }
  }
  if (!result->violations.empty() && CostFunctionsRemember(result)) {
    result->violations.clear();
  }
  if (result->violations.empty()) {
    result->within_spread = std::move(suspected);
  }
}

// A solver that fails where the one asked for does not is no measure of it.
void SecondOpinion::SolveWith(const Options& other, CrossCheckResult* result) {
  CrossCheckResult pair;
  pair.stock = result->stock;
  layout_.Write(states_.start);
  const double seconds = SecondsOf([&] { SolveWithStock(other, problem_, &pair.ours); });
  if (result->stock.IsSolutionUsable() && !pair.ours.IsSolutionUsable()) {
    return;
  }
  const SolvedStates states = {states_.start, layout_.Read(), states_.stock};
  Compare(layout_, states, tolerances_, Excuse(), &pair);
  Widen(pair, factor_, &excuse_);
  if (!result->spread) {
    result->spread.emplace().linear_solvers =
        ceres::LinearSolverTypeToString(result->stock.linear_solver_type_used);
  }
  StockSpread& spread = *result->spread;
  spread.linear_solvers +=
      std::string(", ") + ceres::LinearSolverTypeToString(pair.ours.linear_solver_type_used);
  spread.cost = std::max(spread.cost, std::abs(pair.cost_difference));
  spread.parameter = std::max(spread.parameter, pair.parameters.relative);
  const int surplus = static_cast<int>(pair.ours.iterations.size()) -
                      static_cast<int>(pair.stock.iterations.size());
  spread.iterations = std::max(spread.iterations, std::abs(surplus));
  if (pair.first_different_iteration >= 0) {
    spread.first_different_iteration =
        spread.first_different_iteration < 0
            ? pair.first_different_iteration
            : std::min(spread.first_different_iteration, pair.first_different_iteration);
  }
  spread.seconds += seconds;
}

void SecondOpinion::JudgeAnew(CrossCheckResult* result) const {
  result->violations.clear();
  result->first_different_iteration = -1;
  result->parameters = ParameterDifference();
  Compare(layout_, states_, tolerances_, excuse_, result);
}

// Our solver makes the same bits of the same problem. What makes it meet another cost at the same
// start is not in it. Failures are never excused by this.
bool SecondOpinion::CostFunctionsRemember(CrossCheckResult* result) const {
  if (ours_again_ == nullptr || !result->stock.IsSolutionUsable() ||
      !result->ours.IsSolutionUsable()) {
    return false;
  }
  CrossCheckResult again;
  again.stock = result->stock;
  layout_.Write(states_.start);
  ours_again_(quiet_, &again.ours);
  if (again.ours.initial_cost == result->ours.initial_cost) {
    return false;
  }
  Compare(layout_, {states_.start, layout_.Read(), states_.stock}, tolerances_, excuse_, &again);
  if (!again.violations.empty()) {
    return false;
  }
  result->first_different_iteration = -1;
  result->reason = Excused(result->ours.initial_cost, again.ours.initial_cost);
  return true;
}

}  // namespace inceres::internal
