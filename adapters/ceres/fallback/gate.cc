#include "adapters/ceres/fallback/gate.h"

#include <glog/logging.h>

#include "adapters/ceres/read/selection.h"

namespace inceres::internal {
namespace {

// Up to here nobody asks whether there is memory for DENSE_QR.
constexpr double kMaxUncheckedQrBytes = 64.0 * 1024 * 1024;

std::string OrderingObstacle(const ceres::Solver::Options& options, const ProblemView& view,
                             const OrderingView& ordering, ceres::LinearSolverType type) {
  // With dynamic_sparsity Ceres does not look at the ordering.
  const bool has_cholesky = (type == ceres::SPARSE_NORMAL_CHOLESKY && !options.dynamic_sparsity) ||
                            (type == ceres::CGNR && options.preconditioner_type == ceres::SUBSET);
  if (!ordering.given || !(IsSchurType(type) || has_cholesky)) {
    return "";
  }
  if (ordering.has_unknown) {
    return "linear_solver_ordering contains an address that is no parameter block of the problem";
  }
  if (ordering.num_elements != view.reduced.num_parameter_blocks) {
    return "linear_solver_ordering has " + std::to_string(ordering.num_elements) + " of the " +
           std::to_string(view.reduced.num_parameter_blocks) + " variable parameter blocks";
  }
  if (IsSchurType(type) && ordering.group_sizes.size() > 1 &&
      !IsIndependentSet(view, ordering.first_group)) {
    return "the first group of linear_solver_ordering is not an independent set";
  }
  return "";
}

std::string InfeasibleBounds(const ProblemView& view) {
  for (const ParameterBlockView& block : view.blocks) {
    if (block.bounds == BoundsKind::kInfeasible) {
      return Describe(block) + (block.constant ? " is constant outside its bounds"
                                               : " has a lower bound not below its upper bound");
    }
  }
  return "";
}

// What exact mode cannot do either.
std::string CommonObstacle(const ceres::Solver::Options& options, const ProblemView& view,
                           const OrderingView& ordering) {
  if (!view.defect.empty()) {
    return view.defect;
  }
  const std::string obstacle = InfeasibleBounds(view);
  if (!obstacle.empty() || view.reduced.num_parameter_blocks == 0) {
    return obstacle;  // with nothing to solve for, ordering and linear solver do not matter
  }
  return OrderingObstacle(options, view, ordering, EffectiveLinearSolver(options, ordering));
}

// The Jacobian, and with the damping rows what is made of it.
std::string TooLargeForQr(const ProblemView& view, const AvailableMemory& available) {
  const double columns = view.reduced.num_effective_parameters;
  const double rows = view.reduced.num_residuals;
  const double bytes = sizeof(double) * columns * (2.0 * rows + columns);
  if (bytes <= kMaxUncheckedQrBytes || bytes <= available()) {
    return "";
  }
  return "memory: DENSE_QR of " + std::to_string(static_cast<long>(rows + columns)) + " x " +
         std::to_string(static_cast<long>(columns)) + " entries takes more than is available";
}

// In either mode.
std::string CommonOptionsObstacle(const ceres::Solver::Options& options) {
  std::string error;
  if (!options.IsValid(&error)) {
    return "the options are invalid: " + error;
  }
  if (options.minimizer_type != ceres::TRUST_REGION) {
    return "minimizer_type LINE_SEARCH";
  }
  if (options.linear_solver_ordering != nullptr &&
      options.linear_solver_ordering->NumElements() == 0) {
    return "linear_solver_ordering is empty";
  }
  if (options.min_lm_diagonal <= 0.0) {
    return "min_lm_diagonal 0";
  }
  return "";
}

}  // namespace

void Decline(const SolveCall& call, const std::string& reason) {
  call.report->fallback_reason = reason;
  call.report->exact_reason.clear();  // it is not solved here, exactly or not
  if (call.solve_options.strict) {
    call.summary->termination_type = ceres::FAILURE;
    call.summary->message =
        "inceres does not solve this problem, and strict forbids stock Ceres: " + reason;
    return;
  }
  call.report->used_stock = true;
  LOG(INFO) << "inceres: handed to stock Ceres: " << reason;
  SolveWithStock(call.options, call.problem, call.summary);
}

std::string DenseQrObstacle(const ceres::Solver::Options& options, const ProblemView& view,
                            const OrderingView& ordering, const AvailableMemory& available) {
  const bool nothing_to_solve = view.reduced.num_parameter_blocks == 0;
  return nothing_to_solve || EffectiveLinearSolver(options, ordering) != ceres::DENSE_QR
             ? ""
             : TooLargeForQr(view, available);
}

std::string OptionsObstacle(const ceres::Solver::Options& options) {
  const std::string obstacle = CommonOptionsObstacle(options);
  const ceres::PreconditionerType preconditioner = options.preconditioner_type;
  const bool known = preconditioner == ceres::IDENTITY || preconditioner == ceres::JACOBI ||
                     ((preconditioner == ceres::SCHUR_JACOBI || IsByClusters(preconditioner)) &&
                      options.linear_solver_type == ceres::ITERATIVE_SCHUR) ||
                     (preconditioner == ceres::SUBSET && options.linear_solver_type == ceres::CGNR);
  if (obstacle.empty() && IsIterative(options.linear_solver_type) && !known) {
    return std::string("preconditioner_type ") + ceres::PreconditionerTypeToString(preconditioner) +
           " with " + ceres::LinearSolverTypeToString(options.linear_solver_type);
  }
  return obstacle;
}

std::string NeedsExactMode(const ceres::Solver::Options& options,
                           const ceres::EvaluationCallback* evaluation_callback) {
  if (evaluation_callback != nullptr) {
    return "an evaluation callback, which is told of whole points only";
  }
  if (options.check_gradients) {
    return "check_gradients, and incremental steps evaluate some factors at a time";
  }
  if (!options.trust_region_minimizer_iterations_to_dump.empty()) {
    return "trust_region_minimizer_iterations_to_dump, and incremental steps have other systems";
  }
  if (options.use_inner_iterations) {
    return "use_inner_iterations: coordinate descent after each step of the whole problem";
  }
  return options.linear_solver_type == ceres::DENSE_QR
             ? "linear_solver_type DENSE_QR, and incremental steps form normal equations"
             : "";
}

std::string NeedsExactMode(const ProblemView& view) {
  const ParameterBlockView* bounded = FindBoundsOnManifold(view);
  return bounded == nullptr
             ? ""
             : "bounds of values that steps do not move one by one: " + Describe(*bounded) +
                   " has some, and is on a manifold";
}

std::string FindObstacle(const ceres::Solver::Options& options, bool incremental,
                         const ceres::EvaluationCallback* evaluation_callback,
                         const std::function<void()>& look, const ProblemView& view,
                         OrderingView* ordering, std::string* exact_reason) {
  *exact_reason = incremental ? NeedsExactMode(options, evaluation_callback) : "";
  const auto is_incremental = [&] { return incremental && exact_reason->empty(); };
  std::string obstacle =
      is_incremental() ? CommonOptionsObstacle(options) : OptionsObstacle(options);
  if (!obstacle.empty()) {
    return obstacle;
  }
  look();
  *ordering = ReadOrdering(options, view);
  obstacle = CommonObstacle(options, view, *ordering);
  if (obstacle.empty() && is_incremental()) {
    // Calls code of the user's: only where no mode has an obstacle.
    *exact_reason = NeedsExactMode(view);
    obstacle = is_incremental() ? "" : OptionsObstacle(options);
  }
  return !obstacle.empty() || is_incremental() ? obstacle
                                               : DenseQrObstacle(options, view, *ordering);
}

std::string FindObstacle(const ceres::Solver::Options& options, bool incremental,
                         const ceres::EvaluationCallback* evaluation_callback,
                         const ceres::Problem& problem) {
  ProblemView view;
  OrderingView ordering;
  std::string exact_reason;
  return FindObstacle(
      options, incremental, evaluation_callback, [&] { Introspect(problem, &view); }, view,
      &ordering, &exact_reason);
}

}  // namespace inceres::internal
