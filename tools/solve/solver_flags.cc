#include "tools/solve/solver_flags.h"

#include <algorithm>
#include <utility>

#include <ceres/types.h>
#include <gflags/gflags.h>

#include "src/base/text.h"
#include "tools/command_line/command_line.h"

DEFINE_string(trust_region, "lm", "Trust-region strategy: lm (Levenberg-Marquardt) or dogleg.");
DEFINE_string(
    linear_solver, "auto",
    "Linear solver: auto, dense_schur, sparse_schur, iterative_schur, "
    "sparse_normal_cholesky, dense_normal_cholesky, "
    "dense_qr or cgnr, as Ceres names them. auto: a Schur solver for bal and vio, "
    "sparse_normal_cholesky for pose graphs. "
    "lagged_pcg, with --builtin_factors: conjugate gradients with an earlier factor. Of the "
    "Cholesky and Schur ones on a ceres::Problem it takes whichever it predicts to "
    "be cheapest, with --builtin_factors the one named, and for auto the cheapest, PCG "
    "among them. In ab_compare this is for "
    "inceres; stock runs in --configurations.");
DEFINE_double(max_memory, 0.0,
              "GiB that a solve by inceres may take beside the problem; one that takes more ends "
              "with the figures. 0: what the machine has left.");
DEFINE_string(
    preconditioner, "schur_jacobi",
    "Of --linear_solver iterative_schur: identity, jacobi, schur_jacobi, cluster_jacobi, "
    "cluster_tridiagonal or, with --builtin_factors or --mode incremental, two_level (not of "
    "Ceres: stock then takes schur_jacobi); cgnr takes jacobi in place of the last four.");
DEFINE_bool(single_precision, false,
            "Keep Jacobians in single precision, which halves their memory: with --linear_solver "
            "iterative_schur and --builtin_factors, or with --preconditioner two_level and --mode "
            "incremental.");
DEFINE_bool(recompute_jacobians, false,
            "Keep no Jacobians, and evaluate them anew for each pass over them, as is done where "
            "there is no memory for them: with --builtin_factors, where steps come from a factor.");
DEFINE_string(mode, "exact",
              "exact (follows the iterations of Ceres) or incremental (re-uses Jacobians while "
              "they are good enough).");
DEFINE_bool(builtin_factors, false,
            "Let inceres use its own analytic factors on its own factor graph instead of cost "
            "functions; bal and vio only.");

namespace inceres::tools {
namespace {

using internal::LowerCase;

constexpr double kBytesPerGibibyte = 1073741824.0;
constexpr double kMostMemory = 1e9;  // GiB: as good as no limit

Status ParseLinearSolver(const std::string& text, SolverSettings* settings) {
  settings->lagged_pcg = text == "lagged_pcg";
  if (settings->lagged_pcg && !FLAGS_builtin_factors) {
    return Invalid("--linear_solver lagged_pcg: with --builtin_factors only");
  }
  return Choose<std::optional<ceres::LinearSolverType>>(
      "--linear_solver", text,
      {{"auto", std::nullopt},
       {"dense_schur", ceres::DENSE_SCHUR},
       {"sparse_schur", ceres::SPARSE_SCHUR},
       {"iterative_schur", ceres::ITERATIVE_SCHUR},
       {"sparse_normal_cholesky", ceres::SPARSE_NORMAL_CHOLESKY},
       {"dense_normal_cholesky", ceres::DENSE_NORMAL_CHOLESKY},
       {"dense_qr", ceres::DENSE_QR},
       {"cgnr", ceres::CGNR},
       {"lagged_pcg", std::nullopt}},
      &settings->linear_solver);
}

Status ParsePreconditioner(const std::string& text, SolverSettings* settings) {
  settings->two_level = text == "two_level";
  if (settings->two_level && !FLAGS_builtin_factors && FLAGS_mode != "incremental") {
    return Invalid("--preconditioner two_level: with --builtin_factors or --mode incremental");
  }
  return Choose("--preconditioner", text,
                {{"identity", ceres::IDENTITY},
                 {"jacobi", ceres::JACOBI},
                 {"schur_jacobi", ceres::SCHUR_JACOBI},
                 {"cluster_jacobi", ceres::CLUSTER_JACOBI},
                 {"cluster_tridiagonal", ceres::CLUSTER_TRIDIAGONAL},
                 {"two_level", ceres::SCHUR_JACOBI}},
                &settings->preconditioner);
}

// Where conjugate gradients are sure to be ours.
Status CheckSinglePrecision(const SolverSettings& read) {
  const bool ours = read.incremental
                        ? read.two_level
                        : FLAGS_builtin_factors && read.linear_solver == ceres::ITERATIVE_SCHUR;
  return !FLAGS_single_precision || ours
             ? Status::Ok()
             : Invalid(
                   "--single_precision: with --linear_solver iterative_schur --builtin_factors, or "
                   "with --preconditioner two_level --mode incremental");
}

Status CheckRecomputing(const SolverSettings& read) {
  return !FLAGS_recompute_jacobians || (FLAGS_builtin_factors && !read.incremental)
             ? Status::Ok()
             : Invalid("--recompute_jacobians: with --builtin_factors and --mode exact");
}

// Where nobody's steps come from conjugate gradients.
Status CheckConjugateGradients(const SolverSettings& read) {
  std::string stock;  // of ab_compare
  const bool named = read.linear_solver == ceres::ITERATIVE_SCHUR ||
                     read.linear_solver == ceres::CGNR || (read.incremental && read.two_level) ||
                     (gflags::GetCommandLineOption("configurations", &stock) &&
                      stock.find("iterative_schur") != std::string::npos);
  // It may take them, and then chooses the preconditioner.
  const bool automatic = FLAGS_builtin_factors && !read.incremental &&
                         !read.linear_solver.has_value() && !read.lagged_pcg;
  for (const auto& [flag, is_read] :
       {std::pair("preconditioner", named), std::pair("eta", named || automatic),
        std::pair("max_linear_solver_iterations", named || automatic)}) {
    if (IsSet(flag) && !is_read) {
      return Invalid(std::string("--") + flag +
                     ": is for conjugate gradients: with --linear_solver iterative_schur or cgnr, "
                     "or with --preconditioner two_level --mode incremental");
    }
  }
  return Status::Ok();
}

// Without a Schur complement there is no preconditioner by it.
ceres::PreconditionerType PreconditionerOf(const SolverSettings& settings,
                                           ceres::LinearSolverType type) {
  const bool plain =
      settings.preconditioner == ceres::IDENTITY || settings.preconditioner == ceres::JACOBI;
  return type == ceres::CGNR && !plain ? ceres::JACOBI : settings.preconditioner;
}

Status ToCore(const SolverSettings& settings, ConjugateGradientsOptions* options) {
  options->eta = settings.eta;
  options->max_iterations = settings.max_linear_solver_iterations;
  options->single_precision_jacobians = settings.single_precision;
  if (settings.two_level && *settings.linear_solver == ceres::ITERATIVE_SCHUR) {
    options->preconditioner = PreconditionerKind::kTwoLevel;
    return Status::Ok();
  }
  switch (PreconditionerOf(settings, *settings.linear_solver)) {
    case ceres::IDENTITY:
      options->preconditioner = PreconditionerKind::kIdentity;
      return Status::Ok();
    case ceres::JACOBI:
      options->preconditioner = PreconditionerKind::kJacobi;
      return Status::Ok();
    case ceres::SCHUR_JACOBI:
      options->preconditioner = PreconditionerKind::kSchurJacobi;
      return Status::Ok();
    case ceres::CLUSTER_JACOBI:
      options->preconditioner = PreconditionerKind::kClusterJacobi;
      return Status::Ok();
    case ceres::CLUSTER_TRIDIAGONAL:
      options->preconditioner = PreconditionerKind::kClusterTridiagonal;
      return Status::Ok();
    default:
      return Invalid("--preconditioner " +
                     LowerCase(ceres::PreconditionerTypeToString(settings.preconditioner)) +
                     " is not available with --builtin_factors");
  }
}

}  // namespace

ConjugateGradientsOptions TwoLevels(const SolverSettings& settings) {
  ConjugateGradientsOptions options;
  options.preconditioner = PreconditionerKind::kTwoLevel;
  options.eta = settings.eta;
  options.eta_follows_gradient = true;
  options.single_precision_jacobians = settings.single_precision;
  options.max_iterations = settings.max_linear_solver_iterations;
  return options;
}

Status ReadSolverFlags(SolverSettings* settings) {
  SolverSettings read;
  for (Status& status : std::vector<Status>{
           Choose("--mode", FLAGS_mode, {{"exact", false}, {"incremental", true}},
                  &read.incremental),
           Choose("--trust_region", FLAGS_trust_region,
                  {{"lm", ceres::LEVENBERG_MARQUARDT}, {"dogleg", ceres::DOGLEG}},
                  &read.trust_region),
           ParseLinearSolver(FLAGS_linear_solver, &read),
           ParsePreconditioner(FLAGS_preconditioner, &read), ReadCommonFlags(&read),
           CheckNumbers({}, {{"--max_memory", FLAGS_max_memory}}), CheckSinglePrecision(read),
           CheckRecomputing(read), CheckConjugateGradients(read)}) {
    if (!status.ok()) {
      return status;
    }
  }
  read.single_precision = FLAGS_single_precision;
  read.recompute_jacobians = FLAGS_recompute_jacobians;
  read.max_memory_bytes =
      static_cast<std::int64_t>(std::min(FLAGS_max_memory, kMostMemory) * kBytesPerGibibyte);
  read.builtin_factors = FLAGS_builtin_factors;
  *settings = read;
  return Status::Ok();
}

ceres::LinearSolverType LinearSolverOr(const SolverSettings& settings,
                                       ceres::LinearSolverType automatic) {
  return settings.linear_solver.value_or(automatic);
}

std::string FlagName(ceres::LinearSolverType type) {
  return LowerCase(ceres::LinearSolverTypeToString(type));
}

Status ToCeresOptions(const SolverSettings& settings, ceres::LinearSolverType type,
                      ceres::Solver::Options* options) {
  ceres::Solver::Options result;
  result.trust_region_strategy_type = settings.trust_region;
  result.use_inner_iterations = settings.inner_iterations;
  result.linear_solver_type = type;
  if (type == ceres::ITERATIVE_SCHUR || type == ceres::CGNR) {
    result.preconditioner_type = PreconditionerOf(settings, type);
    result.eta = settings.eta;
    result.max_linear_solver_iterations = settings.max_linear_solver_iterations;
  }
  CopyNumbers(settings, &result);
  result.logging_type = ceres::SILENT;  // the tools print their own table
  std::string error;
  if (!result.IsValid(&error)) {
    return Invalid("these options do not go together: " + error);
  }
  *options = result;
  return Status::Ok();
}

Status ToCoreOptions(const SolverSettings& settings, SolverOptions* options) {
  SolverOptions result;
  result.max_memory_bytes = settings.max_memory_bytes;
  result.recompute_jacobians = settings.recompute_jacobians;
  result.conjugate_gradients.eta = settings.eta;
  result.conjugate_gradients.max_iterations = settings.max_linear_solver_iterations;
  result.reduced_solver =
      settings.lagged_pcg ? ReducedSolverKind::kPcg : ReducedSolverKind::kAutomaticInexact;
  if (settings.linear_solver.has_value()) {
    switch (*settings.linear_solver) {
      case ceres::DENSE_SCHUR:
      case ceres::SPARSE_SCHUR:
        result.linear_model = LinearModelKind::kSchur;
        break;
      case ceres::DENSE_NORMAL_CHOLESKY:
      case ceres::SPARSE_NORMAL_CHOLESKY:
        result.linear_model = LinearModelKind::kPlain;
        break;
      case ceres::DENSE_QR:
        result.linear_model = LinearModelKind::kDenseQr;
        break;
      case ceres::ITERATIVE_SCHUR:
        result.linear_model = LinearModelKind::kIterativeSchur;
        break;
      default:
        result.linear_model = LinearModelKind::kIterativePlain;
    }
    const bool dense = *settings.linear_solver == ceres::DENSE_SCHUR ||
                       *settings.linear_solver == ceres::DENSE_NORMAL_CHOLESKY;
    result.reduced_solver = dense ? ReducedSolverKind::kDense : ReducedSolverKind::kSparse;
    if (IsIterative(result.linear_model)) {
      const Status known = ToCore(settings, &result.conjugate_gradients);
      if (!known.ok()) {
        return known;
      }
    }
  }
  result.strategy = settings.trust_region == ceres::DOGLEG
                        ? TrustRegionStrategyKind::kDogleg
                        : TrustRegionStrategyKind::kLevenbergMarquardt;
  CopyNumbers(settings, &result);
  Status status = result.Validate();
  if (status.ok()) {
    *options = result;
  }
  return status;
}

Status ToIncrementalOptions(const SolverSettings& settings, IncrementalOptions* options,
                            std::vector<std::string>* without_effect) {
  if (settings.linear_solver.has_value()) {
    return Invalid(
        "--linear_solver " + FlagName(*settings.linear_solver) +
        ": with --mode incremental --builtin_factors there is only one; leave it at auto");
  }
  const SolverSettings defaults;
  const std::pair<const char*, bool> ignored[] = {
      {"--gradient_tolerance", settings.gradient_tolerance != defaults.gradient_tolerance},
      {"--parameter_tolerance", settings.parameter_tolerance != defaults.parameter_tolerance}};
  for (const auto& [flag, set] : ignored) {
    if (set) {
      without_effect->emplace_back(flag);
    }
  }
  IncrementalOptions result;
  result.batch_max_memory_bytes = settings.max_memory_bytes;
  if (settings.two_level) {
    result.batch_linear_model = LinearModelKind::kIterativeSchur;
    result.batch_conjugate_gradients = TwoLevels(settings);
  }
  result.max_num_iterations = settings.max_num_iterations;
  result.function_tolerance = settings.function_tolerance;
  result.num_threads = settings.num_threads;
  result.batch_strategy = settings.trust_region == ceres::DOGLEG
                              ? TrustRegionStrategyKind::kDogleg
                              : TrustRegionStrategyKind::kLevenbergMarquardt;
  result.initial_damping = std::clamp(1.0 / settings.initial_trust_region_radius,
                                      result.min_damping, result.max_damping);
  const Status status = result.Validate();
  if (status.ok()) {
    *options = result;
  }
  return status;
}

}  // namespace inceres::tools
