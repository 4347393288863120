#include "options.h"

#include <functional>
#include <map>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "arrays.h"
#include "module.h"

namespace inceres::python {
namespace {

template <typename Enum>
using Names = std::vector<std::pair<const char*, Enum>>;

const Names<TrustRegionStrategyKind> kStrategies = {
    {"levenberg_marquardt", TrustRegionStrategyKind::kLevenbergMarquardt},
    {"marquardt", TrustRegionStrategyKind::kMarquardt},
    {"dogleg", TrustRegionStrategyKind::kDogleg},
    {"subspace_dogleg", TrustRegionStrategyKind::kSubspaceDogleg}};
const Names<LinearModelKind> kLinearModels = {
    {"automatic", LinearModelKind::kAutomatic},
    {"schur", LinearModelKind::kSchur},
    {"plain", LinearModelKind::kPlain},
    {"dense_qr", LinearModelKind::kDenseQr},
    {"iterative_schur", LinearModelKind::kIterativeSchur},
    {"iterative_plain", LinearModelKind::kIterativePlain}};
const Names<PreconditionerKind> kPreconditioners = {
    {"identity", PreconditionerKind::kIdentity},
    {"jacobi", PreconditionerKind::kJacobi},
    {"schur_jacobi", PreconditionerKind::kSchurJacobi},
    {"two_level", PreconditionerKind::kTwoLevel},
    {"cluster_jacobi", PreconditionerKind::kClusterJacobi},
    {"cluster_tridiagonal", PreconditionerKind::kClusterTridiagonal}};
const Names<VisibilityClusteringKind> kClusterings = {
    {"canonical_views", VisibilityClusteringKind::kCanonicalViews},
    {"single_linkage", VisibilityClusteringKind::kSingleLinkage}};
const Names<LineSearchInterpolation> kInterpolations = {
    {"bisection", LineSearchInterpolation::kBisection},
    {"quadratic", LineSearchInterpolation::kQuadratic},
    {"cubic", LineSearchInterpolation::kCubic}};
const Names<RebuildPolicy> kRebuilds = {{"when_cheaper", RebuildPolicy::kWhenCheaper},
                                        {"always", RebuildPolicy::kAlways},
                                        {"never", RebuildPolicy::kNever}};
const Names<RelinearizationRule> kRelinearizations = {
    {"residual_error", RelinearizationRule::kResidualError},
    {"step_size", RelinearizationRule::kStepSize}};
const Names<DampingForm> kDampings = {{"hybrid", DampingForm::kHybrid},
                                      {"thesis", DampingForm::kThesis}};
const Names<ReducedSolverKind> kReducedSolvers = {
    {"automatic", ReducedSolverKind::kAutomatic},
    {"dense", ReducedSolverKind::kDense},
    {"sparse", ReducedSolverKind::kSparse},
    {"resumed", ReducedSolverKind::kResumed},
    {"pcg", ReducedSolverKind::kPcg},
    {"automatic_inexact", ReducedSolverKind::kAutomaticInexact}};

/// Sets options by name; knows how each is read from Python and written back.
template <typename Options>
class Table {
 public:
  template <typename T>
  Table& Add(const char* name, T Options::*member) {
    return Insert(
        name,
        [name, member](const py::handle& value, Options* options) {
          try {
            if (std::is_same_v<T, bool> && !py::isinstance<py::bool_>(value)) {
              throw py::cast_error();
            }
            options->*member = value.cast<T>();
          } catch (const py::cast_error&) {
            throw py::type_error(std::string(name) + ": " + py::repr(value).cast<std::string>() +
                                 ", expected a " +
                                 (std::is_same_v<T, bool>       ? "bool"
                                  : std::is_floating_point_v<T> ? "float"
                                                                : "whole number"));
          }
        },
        [member](const Options& options) -> py::object { return py::cast(options.*member); });
  }

  template <typename Enum>
  Table& Add(const char* name, Enum Options::*member, const Names<Enum>& names) {
    return Insert(
        name,
        [name, member, &names](const py::handle& value, Options* options) {
          std::string known;
          for (const auto& [text, kind] : names) {
            if (py::isinstance<py::str>(value) && value.cast<std::string>() == text) {
              options->*member = kind;
              return;
            }
            known += (known.empty() ? "" : ", ") + std::string(text);
          }
          throw py::value_error(std::string(name) + ": " + py::repr(value).cast<std::string>() +
                                ", expected one of " + known);
        },
        [member, &names](const Options& options) -> py::object {
          for (const auto& [text, kind] : names) {
            if (options.*member == kind) {
              return py::str(text);
            }
          }
          return py::none();
        });
  }

  // A group of options: a dict, of which what is not there keeps its default.
  template <typename Group>
  Table& Add(const char* name, Group Options::*member, const Table<Group>& table) {
    return Insert(
        name,
        [name, member, table](const py::handle& value, Options* options) {
          if (!py::isinstance<py::dict>(value)) {
            throw py::type_error(std::string(name) + ": " + py::repr(value).cast<std::string>() +
                                 ", expected a dict");
          }
          table.Fill(py::reinterpret_borrow<py::dict>(value), name, &(options->*member));
        },
        [table](const Options& /*options*/) -> py::object { return table.Defaults(); });
  }

  Options Read(const py::dict& given) const {
    Options options;
    Fill(given, "", &options);
    Check(options.Validate());
    return options;
  }

  // `group`: what the options belong to, or empty.
  void Fill(const py::dict& given, const std::string& group, Options* options) const {
    for (const auto& [key, value] : given) {
      const std::string name = py::str(key);
      const auto found = entries_.find(name);
      if (found == entries_.end()) {
        throw py::type_error((group.empty() ? "" : group + ": ") + "unknown option '" + name +
                             "'; there are " + Known());
      }
      found->second.first(value, options);
    }
  }

  py::dict Defaults() const {
    py::dict defaults;
    for (const auto& [name, entry] : entries_) {
      defaults[name.c_str()] = entry.second(Options());
    }
    return defaults;
  }

 private:
  using Set = std::function<void(const py::handle&, Options*)>;
  using Get = std::function<py::object(const Options&)>;

  Table& Insert(const char* name, Set set, Get get) {
    entries_.emplace(name, std::make_pair(std::move(set), std::move(get)));
    return *this;
  }
  std::string Known() const {
    std::string names;
    for (const auto& entry : entries_) {
      names += (names.empty() ? "" : ", ") + entry.first;
    }
    return names;
  }

  std::map<std::string, std::pair<Set, Get>> entries_;
};

Table<ConjugateGradientsOptions> MakeConjugateGradientsTable() {
  using O = ConjugateGradientsOptions;
  Table<O> table;
  table.Add("preconditioner", &O::preconditioner, kPreconditioners)
      .Add("eta", &O::eta)
      .Add("min_iterations", &O::min_iterations)
      .Add("eta_follows_gradient", &O::eta_follows_gradient)
      .Add("max_iterations", &O::max_iterations)
      .Add("explicit_schur_complement", &O::explicit_schur_complement)
      .Add("single_precision_jacobians", &O::single_precision_jacobians)
      .Add("visibility_clustering", &O::visibility_clustering, kClusterings);
  return table;
}

Table<SolverOptions> MakeSolverTable() {
  using O = SolverOptions;
  Table<O> table;
  table.Add("strategy", &O::strategy, kStrategies)
      .Add("linear_model", &O::linear_model, kLinearModels)
      .Add("reduced_solver", &O::reduced_solver, kReducedSolvers)
      .Add("conjugate_gradients", &O::conjugate_gradients, MakeConjugateGradientsTable())
      .Add("dynamic_sparsity", &O::dynamic_sparsity)
      .Add("num_threads", &O::num_threads)
      .Add("max_memory_bytes", &O::max_memory_bytes)
      .Add("recompute_jacobians", &O::recompute_jacobians)
      .Add("max_num_iterations", &O::max_num_iterations)
      .Add("max_solver_time_in_seconds", &O::max_solver_time_in_seconds)
      .Add("function_tolerance", &O::function_tolerance)
      .Add("gradient_tolerance", &O::gradient_tolerance)
      .Add("parameter_tolerance", &O::parameter_tolerance)
      .Add("initial_trust_region_radius", &O::initial_trust_region_radius)
      .Add("max_trust_region_radius", &O::max_trust_region_radius)
      .Add("min_trust_region_radius", &O::min_trust_region_radius)
      .Add("min_relative_decrease", &O::min_relative_decrease)
      .Add("min_lm_diagonal", &O::min_lm_diagonal)
      .Add("max_lm_diagonal", &O::max_lm_diagonal)
      .Add("max_num_consecutive_invalid_steps", &O::max_num_consecutive_invalid_steps)
      .Add("jacobi_scaling", &O::jacobi_scaling)
      .Add("use_nonmonotonic_steps", &O::use_nonmonotonic_steps)
      .Add("max_consecutive_nonmonotonic_steps", &O::max_consecutive_nonmonotonic_steps)
      .Add("refine_landmarks", &O::refine_landmarks)
      .Add("reduce_curvature_of_losses", &O::reduce_curvature_of_losses)
      .Add("line_search_interpolation", &O::line_search_interpolation, kInterpolations)
      .Add("line_search_sufficient_function_decrease", &O::line_search_sufficient_function_decrease)
      .Add("max_line_search_step_contraction", &O::max_line_search_step_contraction)
      .Add("min_line_search_step_contraction", &O::min_line_search_step_contraction)
      .Add("min_line_search_step_size", &O::min_line_search_step_size)
      .Add("max_num_line_search_step_size_iterations",
           &O::max_num_line_search_step_size_iterations);
  return table;
}

Table<IncrementalOptions> MakeIncrementalTable() {
  using O = IncrementalOptions;
  Table<O> table;
  table.Add("max_num_iterations", &O::max_num_iterations)
      .Add("max_solver_time_in_seconds", &O::max_solver_time_in_seconds)
      .Add("max_factor_evaluations", &O::max_factor_evaluations)
      .Add("function_tolerance", &O::function_tolerance)
      .Add("gradient_tolerance", &O::gradient_tolerance)
      .Add("parameter_tolerance", &O::parameter_tolerance)
      .Add("fixed_cost", &O::fixed_cost)
      .Add("min_relative_decrease", &O::min_relative_decrease)
      .Add("initial_damping", &O::initial_damping)
      .Add("min_damping", &O::min_damping)
      .Add("claim_damping_share", &O::claim_damping_share)
      .Add("max_damping", &O::max_damping)
      .Add("batch_share", &O::batch_share)
      .Add("batch_strategy", &O::batch_strategy, kStrategies)
      .Add("batch_linear_model", &O::batch_linear_model, kLinearModels)
      .Add("batch_reduced_solver", &O::batch_reduced_solver, kReducedSolvers)
      .Add("batch_conjugate_gradients", &O::batch_conjugate_gradients,
           MakeConjugateGradientsTable())
      .Add("batch_max_memory_bytes", &O::batch_max_memory_bytes)
      .Add("num_threads", &O::num_threads)
      .Add("damping", &O::damping, kDampings)
      .Add("relinearization", &O::relinearization, kRelinearizations)
      .Add("relinearization_share", &O::relinearization_share)
      .Add("relinearization_step", &O::relinearization_step)
      .Add("truncation_share", &O::truncation_share)
      .Add("max_landmark_refinements", &O::max_landmark_refinements)
      .Add("max_new_frame_steps", &O::max_new_frame_steps)
      .Add("rebuild", &O::rebuild, kRebuilds)
      .Add("reduced_solver", &O::reduced_solver, kReducedSolvers);
  return table;
}

const Table<SolverOptions>& SolverTable() {
  static const Table<SolverOptions> kTable = MakeSolverTable();
  return kTable;
}
const Table<IncrementalOptions>& IncrementalTable() {
  static const Table<IncrementalOptions> kTable = MakeIncrementalTable();
  return kTable;
}

}  // namespace

SolverOptions ToSolverOptions(const py::dict& options) {
  return SolverTable().Read(options);
}

IncrementalOptions ToIncrementalOptions(const py::dict& options) {
  return IncrementalTable().Read(options);
}

void BindOptions(py::module_& module) {
  module.def(
      "solver_options", [] { return SolverTable().Defaults(); },
      "The options of batch solves and their defaults. Meanings are those of "
      "inceres::SolverOptions, which are Ceres's.");
  module.def(
      "incremental_options", [] { return IncrementalTable().Defaults(); },
      "The options of an IncrementalSolver and their defaults. Meanings are those of "
      "inceres::IncrementalOptions.");
}

}  // namespace inceres::python
