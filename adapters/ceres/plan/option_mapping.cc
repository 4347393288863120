#include "adapters/ceres/plan/option_mapping.h"

#include <algorithm>
#include <climits>
#include <limits>
#include <thread>

#include <glog/logging.h>

#include "adapters/ceres/read/ceres_version.h"
#include "adapters/ceres/read/factor_shapes.h"
#include "adapters/ceres/read/selection.h"

// A name and the member that it names.
#define OPTION(name) #name, &ceres::Solver::Options::name

namespace inceres::internal {
namespace {

// Collects the names of the members that differ from their defaults.
class Differences {
 public:
  explicit Differences(const ceres::Solver::Options& options) : options_(options) {}

  // Names and members in turn.
  template <typename T, typename... Rest>
  void Check(const char* name, T ceres::Solver::Options::*member, Rest... rest) {
    if (options_.*member != defaults_.*member) {
      Add(name);
    }
    if constexpr (sizeof...(rest) > 0) {
      Check(rest...);
    }
  }
  void Add(std::string name) {
    if (std::find(names_.begin(), names_.end(), name) == names_.end()) {
      names_.push_back(std::move(name));
    }
  }
  std::vector<std::string> Take() { return std::move(names_); }

 private:
  const ceres::Solver::Options& options_;
  const ceres::Solver::Options defaults_;
  std::vector<std::string> names_;
};

// Only read by the line-search minimizer.
void CheckLineSearch(Differences* differences) {
  differences->Check(OPTION(line_search_direction_type), OPTION(line_search_type),
                     OPTION(nonlinear_conjugate_gradient_type), OPTION(max_lbfgs_rank),
                     OPTION(use_approximate_eigenvalue_bfgs_scaling),
                     OPTION(max_num_line_search_direction_restarts),
                     OPTION(line_search_sufficient_curvature_decrease),
                     OPTION(max_line_search_step_expansion));
}

// Only read in the projected line search of problems with bounds.
void CheckProjectedLineSearch(Differences* differences) {
  differences->Check(
      OPTION(line_search_interpolation_type), OPTION(min_line_search_step_size),
      OPTION(line_search_sufficient_function_decrease), OPTION(max_line_search_step_contraction),
      OPTION(min_line_search_step_contraction), OPTION(max_num_line_search_step_size_iterations));
}

// Choices within Ceres's own linear algebra.
void CheckLinearSolver(Differences* differences) {
  differences->Check(OPTION(dense_linear_algebra_library_type),
                     OPTION(sparse_linear_algebra_library_type), OPTION(use_mixed_precision_solves),
                     OPTION(max_num_refinement_iterations));
  WithOptionsOfThisRelease(
      [&](auto... names_and_members) { differences->Check(names_and_members...); });
}

// When conjugate gradients stop.
void CheckEndOfIteration(Differences* differences) {
  differences->Check(OPTION(eta), OPTION(min_linear_solver_iterations),
                     OPTION(max_linear_solver_iterations));
}

// By what they get on.
void CheckPreconditioner(Differences* differences) {
  differences->Check(OPTION(preconditioner_type), OPTION(use_explicit_schur_complement));
}

// What belongs to features that are off.
void CheckFeaturesThatAreOff(const ceres::Solver::Options& options, Differences* differences) {
  if (!options.use_inner_iterations) {
    differences->Check(OPTION(inner_iteration_ordering), OPTION(inner_iteration_tolerance));
  }
  if (options.trust_region_minimizer_iterations_to_dump.empty()) {
    differences->Check(OPTION(trust_region_problem_dump_directory),
                       OPTION(trust_region_problem_dump_format_type));
  }
  if (!options.check_gradients) {
    differences->Check(OPTION(gradient_check_relative_precision),
                       OPTION(gradient_check_numeric_derivative_relative_step_size));
  }
  if (options.trust_region_strategy_type == ceres::DOGLEG) {
    differences->Check(OPTION(max_trust_region_radius));  // as in Ceres
  } else {
    differences->Check(OPTION(dogleg_type));
  }
  if (!options.use_nonmonotonic_steps) {
    differences->Check(OPTION(max_consecutive_nonmonotonic_steps));
  }
}

// `numbers_frames`: OrderingView::numbers_frames, where the solver looks at it.
void CheckOrdering(const ceres::Solver::Options& options, const LandmarkCounts& landmarks,
                   bool numbers_frames, Differences* differences) {
  if (options.linear_solver_ordering == nullptr) {
    return;
  }
  const int num_groups = options.linear_solver_ordering->NumGroups();
  if (!IsSchurType(options.linear_solver_type)) {
    differences->Add("linear_solver_ordering");
  } else if (num_groups > 2 && !numbers_frames) {
    differences->Add("linear_solver_ordering: the order of groups after the first");
  }
  if (landmarks.num_too_large > 0) {
    differences->Add("linear_solver_ordering: " + std::to_string(landmarks.num_too_large) +
                     " blocks of the first group have a tangent size above " +
                     std::to_string(kMaxLandmarkSize) + " and stay in the reduced system");
  }
  if (landmarks.num_kept > 0 && num_groups > 1) {
    differences->Add("linear_solver_ordering: " + std::to_string(landmarks.num_kept) +
                     " blocks of the first group stay in the reduced system, which would be fuller "
                     "without them");
  }
}

void CheckCommon(const ceres::Solver::Options& options, const LandmarkCounts& landmarks,
                 bool numbers_frames, Differences* differences) {
  CheckLineSearch(differences);
  CheckLinearSolver(differences);
  CheckFeaturesThatAreOff(options, differences);
  CheckOrdering(options, landmarks, numbers_frames, differences);
}

TrustRegionStrategyKind StrategyOf(const ceres::Solver::Options& options) {
  if (options.trust_region_strategy_type == ceres::LEVENBERG_MARQUARDT) {
    return TrustRegionStrategyKind::kLevenbergMarquardt;
  }
  return options.dogleg_type == ceres::SUBSPACE_DOGLEG ? TrustRegionStrategyKind::kSubspaceDogleg
                                                       : TrustRegionStrategyKind::kDogleg;
}

LinearModelKind LinearModelOf(ceres::LinearSolverType type) {
  switch (type) {
    case ceres::DENSE_QR:
      return LinearModelKind::kDenseQr;
    case ceres::ITERATIVE_SCHUR:
      return LinearModelKind::kIterativeSchur;
    case ceres::CGNR:
      return LinearModelKind::kIterativePlain;
    default:
      return LinearModelKind::kAutomatic;
  }
}

ConjugateGradientsOptions ConjugateGradientsOf(const ceres::Solver::Options& options,
                                               ceres::LinearSolverType type) {
  ConjugateGradientsOptions result;
  switch (PreconditionerFor(options.preconditioner_type, options.linear_solver_type, type)) {
    case ceres::IDENTITY:
      result.preconditioner = PreconditionerKind::kIdentity;
      break;
    case ceres::SCHUR_JACOBI:
      result.preconditioner = PreconditionerKind::kSchurJacobi;
      break;
    case ceres::CLUSTER_JACOBI:
      result.preconditioner = PreconditionerKind::kClusterJacobi;
      break;
    case ceres::CLUSTER_TRIDIAGONAL:
      result.preconditioner = PreconditionerKind::kClusterTridiagonal;
      break;
    case ceres::SUBSET:
      result.preconditioner = PreconditionerKind::kSubset;
      break;
    default:
      result.preconditioner = PreconditionerKind::kJacobi;
  }
  result.visibility_clustering = options.visibility_clustering_type == ceres::SINGLE_LINKAGE
                                     ? VisibilityClusteringKind::kSingleLinkage
                                     : VisibilityClusteringKind::kCanonicalViews;
  result.eta = options.eta;
  result.min_iterations = options.min_linear_solver_iterations;
  result.max_iterations = options.max_linear_solver_iterations;
  result.explicit_schur_complement =
      type == ceres::ITERATIVE_SCHUR && options.use_explicit_schur_complement;
  return result;
}

LineSearchInterpolation InterpolationOf(const ceres::Solver::Options& options) {
  switch (options.line_search_interpolation_type) {
    case ceres::BISECTION:
      return LineSearchInterpolation::kBisection;
    case ceres::QUADRATIC:
      return LineSearchInterpolation::kQuadratic;
    case ceres::CUBIC:
      break;
  }
  return LineSearchInterpolation::kCubic;
}

// Scalar unknowns left when these landmarks are eliminated.
int ReducedSize(const ProblemView& view, const LandmarkSelection& landmarks) {
  int size = 0;
  for (std::size_t b = 0; b < view.blocks.size(); ++b) {
    size +=
        view.blocks[b].reduced() && landmarks.is_landmark[b] == 0 ? view.blocks[b].tangent_size : 0;
  }
  return size;
}

int HardwareThreads() {
  const unsigned hardware = std::thread::hardware_concurrency();
  return hardware == 0 ? INT_MAX : static_cast<int>(hardware);
}

bool NamesSolver(const IncrementalOptions& core) {
  return core.reduced_solver != ReducedSolverKind::kAutomatic ||
         core.batch_reduced_solver != ReducedSolverKind::kAutomatic ||
         core.batch_linear_model != LinearModelKind::kAutomatic;
}

}  // namespace

int NumReaders(const ceres::Solver::Options& options) {
  return options.num_threads <= 1 ? 1 : std::min(options.num_threads, HardwareThreads());
}

int NumThreads(const ceres::Solver::Options& options) {
  if (options.num_threads == 1) {
    return 1;  // to ask for the hardware takes longer than a small solve
  }
  const int available = HardwareThreads();
  if (options.num_threads > available) {
    LOG(WARNING) << "Specified options.num_threads: " << options.num_threads
                 << " exceeds maximum available from the threading model Ceres was compiled with: "
                 << available << ".  Bounding to maximum number available.";
  }
  return std::min(options.num_threads, available);
}

SolverOptions MapOptions(const ceres::Solver::Options& options, ceres::LinearSolverType type) {
  SolverOptions core;
  core.strategy = StrategyOf(options);
  core.linear_model = LinearModelOf(type);
  core.conjugate_gradients = ConjugateGradientsOf(options, type);
  core.dynamic_sparsity = options.dynamic_sparsity && !IsIterative(type);
  core.max_num_iterations = options.max_num_iterations;
  core.max_solver_time_in_seconds = options.max_solver_time_in_seconds;
  core.function_tolerance = options.function_tolerance;
  core.gradient_tolerance = options.gradient_tolerance;
  core.parameter_tolerance = options.parameter_tolerance;
  core.initial_trust_region_radius = options.initial_trust_region_radius;
  core.max_trust_region_radius = options.max_trust_region_radius;
  core.min_trust_region_radius = options.min_trust_region_radius;
  core.min_relative_decrease = options.min_relative_decrease;
  core.min_lm_diagonal = options.min_lm_diagonal;
  core.max_lm_diagonal = options.max_lm_diagonal;
  core.max_num_consecutive_invalid_steps = options.max_num_consecutive_invalid_steps;
  core.jacobi_scaling = options.jacobi_scaling;
  core.use_nonmonotonic_steps = options.use_nonmonotonic_steps;
  core.max_consecutive_nonmonotonic_steps = options.max_consecutive_nonmonotonic_steps;
  core.line_search_interpolation = InterpolationOf(options);
  core.line_search_sufficient_function_decrease = options.line_search_sufficient_function_decrease;
  core.max_line_search_step_contraction = options.max_line_search_step_contraction;
  core.min_line_search_step_contraction = options.min_line_search_step_contraction;
  core.min_line_search_step_size = options.min_line_search_step_size;
  core.max_num_line_search_step_size_iterations = options.max_num_line_search_step_size_iterations;
  return core;
}

std::vector<std::string> OptionsWithoutEffect(const ceres::Solver::Options& options,
                                              const LandmarkCounts& landmarks,
                                              bool is_constrained) {
  Differences differences(options);
  if (!is_constrained) {
    CheckProjectedLineSearch(&differences);
  }
  const bool iterates = IsIterative(options.linear_solver_type);
  const bool by_clusters = iterates && IsByClusters(options.preconditioner_type);
  if (!iterates) {
    CheckEndOfIteration(&differences);
    CheckPreconditioner(&differences);
  }
  if (!by_clusters) {
    differences.Check(OPTION(visibility_clustering_type));
  }
  if (options.linear_solver_type != ceres::CGNR || options.preconditioner_type != ceres::SUBSET) {
    differences.Check(OPTION(residual_blocks_for_subset_preconditioner));
  }
  CheckCommon(options, landmarks, /*numbers_frames=*/by_clusters, &differences);
  return differences.Take();
}

IncrementalOptions MapIncrementalOptions(const ceres::Solver::Options& options,
                                         const IncrementalOptions& core) {
  IncrementalOptions result = core;
  result.max_num_iterations = options.max_num_iterations;
  result.max_solver_time_in_seconds =
      std::max(options.max_solver_time_in_seconds, std::numeric_limits<double>::min());
  result.function_tolerance = options.function_tolerance;
  result.min_relative_decrease = options.min_relative_decrease;
  result.num_threads = NumThreads(options);
  result.batch_strategy = StrategyOf(options);
  if (options.trust_region_strategy_type == ceres::LEVENBERG_MARQUARDT) {
    result.initial_damping =
        std::clamp(1.0 / options.initial_trust_region_radius, core.min_damping, core.max_damping);
  }
  return result;
}

bool IteratesInBatch(const ceres::Solver::Options& options, const IncrementalOptions& core) {
  return options.linear_solver_type == ceres::ITERATIVE_SCHUR && core.batch_share < 1.0 &&
         core.batch_reduced_solver == ReducedSolverKind::kAutomaticInexact;
}

std::vector<std::string> IncrementalOptionsWithoutEffect(const ceres::Solver::Options& options,
                                                         const LandmarkCounts& landmarks,
                                                         bool iterates_in_batch) {
  Differences differences(options);
  differences.Check(
      OPTION(dynamic_sparsity), OPTION(gradient_tolerance), OPTION(parameter_tolerance),
      OPTION(max_trust_region_radius), OPTION(min_trust_region_radius), OPTION(min_lm_diagonal),
      OPTION(max_lm_diagonal), OPTION(max_num_consecutive_invalid_steps), OPTION(jacobi_scaling),
      OPTION(use_nonmonotonic_steps), OPTION(max_consecutive_nonmonotonic_steps));
  if (options.trust_region_strategy_type == ceres::DOGLEG) {
    differences.Check(OPTION(initial_trust_region_radius));
  }
  CheckProjectedLineSearch(&differences);
  if (!iterates_in_batch) {
    CheckEndOfIteration(&differences);
  }
  CheckPreconditioner(&differences);
  differences.Check(OPTION(visibility_clustering_type),
                    OPTION(residual_blocks_for_subset_preconditioner));
  CheckCommon(options, landmarks, /*numbers_frames=*/false, &differences);
  return differences.Take();
}

void ChooseIterativeSolver(const ceres::Solver::Options& options, const ProblemView& view,
                           const OrderingView& ordering, int max_direct_size,
                           IncrementalOptions* core) {
  const ceres::LinearSolverType type = IncrementalLinearSolver(options, ordering);
  if (!IsIterative(type) || NamesSolver(*core) ||
      view.reduced.num_effective_parameters <= max_direct_size) {
    return;
  }
  const LandmarkSelection landmarks =
      SelectLandmarks(view, ordering, FindShapes(view), TypeToPlanIncrementally(options, ordering));
  const bool in_batch = type == ceres::ITERATIVE_SCHUR && landmarks.num_landmarks > 0;
  if (in_batch) {
    core->batch_reduced_solver = ReducedSolverKind::kAutomaticInexact;
    core->batch_conjugate_gradients = ConjugateGradientsOf(options, type);
    core->batch_conjugate_gradients.eta_follows_gradient = true;
  }
  if (ReducedSize(view, landmarks) <= max_direct_size) {
    return;
  }
  core->reduced_solver = ReducedSolverKind::kPcg;
  if (!in_batch && core->batch_share > 0.0) {
    core->batch_share = 1.0;  // the batch solver's solvers are direct
  }
}

IncrementalOptions IncrementalOptionsFor(const SolveInput& input, const IncrementalOptions& core) {
  IncrementalOptions result = MapIncrementalOptions(input.options, core);
  if (input.asked.max_memory_bytes != 0) {
    result.batch_max_memory_bytes = input.asked.max_memory_bytes;
  }
  if (input.asked.conjugate_gradients) {
    result.batch_linear_model = LinearModelKind::kIterativeSchur;
    result.batch_conjugate_gradients = *input.asked.conjugate_gradients;
  }
  ChooseIterativeSolver(input.options, input.view, input.ordering, kMaxDirectSize, &result);
  if (result.batch_share > 0.0 && HasBounds(input.view)) {
    result.batch_share = 1.0;  // the batch solver's clamped steps creep along bounds
  }
  return result;
}

}  // namespace inceres::internal
