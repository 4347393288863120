#include "adapters/ceres/plan/other_linear_solvers.h"

#include <optional>
#include <utility>

#include <ceres/types.h>

namespace inceres::internal {
namespace {

using Options = ceres::Solver::Options;

// A dense solver for what a sparse one was asked for takes no longer up to about here.
constexpr int kMaxDenseSize = 1000;

bool HaveSparse(Options* options) {
  for (const auto library : {options->sparse_linear_algebra_library_type, ceres::SUITE_SPARSE, ceres::EIGEN_SPARSE}) {
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
      return small ? std::vector<ceres::LinearSolverType>{ceres::SPARSE_NORMAL_CHOLESKY, ceres::DENSE_SCHUR}
                   : std::vector<ceres::LinearSolverType>{ceres::SPARSE_NORMAL_CHOLESKY};
    case ceres::SPARSE_NORMAL_CHOLESKY:
      return small ? std::vector<ceres::LinearSolverType>{ceres::SPARSE_SCHUR, ceres::DENSE_NORMAL_CHOLESKY}
                   : std::vector<ceres::LinearSolverType>{ceres::SPARSE_SCHUR};
    default:
      return {};
  }
}

// Normal equations are no measure of a QR factorization, which is there because they lose digits: another one is.
std::optional<Options> OtherLibrary(const Options& quiet) {
  Options other = quiet;
  other.dense_linear_algebra_library_type =
      quiet.dense_linear_algebra_library_type == ceres::EIGEN ? ceres::LAPACK : ceres::EIGEN;
  const bool available = ceres::IsDenseLinearAlgebraLibraryTypeAvailable(other.dense_linear_algebra_library_type);
  return available ? std::optional<Options>(other) : std::nullopt;
}

Options OtherPreconditioner(const Options& quiet, ceres::LinearSolverType type) {
  Options other = quiet;
  const ceres::PreconditionerType second = type == ceres::CGNR ? ceres::IDENTITY : ceres::SCHUR_JACOBI;
  other.preconditioner_type = quiet.preconditioner_type == ceres::JACOBI ? second : ceres::JACOBI;
  return other;
}

}  // namespace

std::vector<Options> OtherLinearSolvers(const Options& quiet, const ceres::Solver::Summary& solved) {
  const ceres::LinearSolverType type = solved.linear_solver_type_used;
  if (type == ceres::DENSE_QR) {
    const std::optional<Options> other = OtherLibrary(quiet);
    return other ? std::vector<Options>{*other} : std::vector<Options>();
  }
  if (type == ceres::ITERATIVE_SCHUR || type == ceres::CGNR) {
    return {OtherPreconditioner(quiet, type)};
  }
  std::vector<Options> others;
  for (const ceres::LinearSolverType other_type : OtherTypes(type, solved.num_effective_parameters_reduced <= kMaxDenseSize)) {
    Options other = quiet;
    other.linear_solver_type = other_type;
    other.dynamic_sparsity = false;
    other.use_mixed_precision_solves = false;
    if (!ceres::IsSchurType(type) || !ceres::IsSchurType(other_type)) {
      other.linear_solver_ordering = nullptr;  // its groups are for the other kind
    }
    const bool sparse = other_type == ceres::SPARSE_SCHUR || other_type == ceres::SPARSE_NORMAL_CHOLESKY;
    if (!sparse || HaveSparse(&other)) {
      others.push_back(std::move(other));
    }
  }
  return others;
}

}  // namespace inceres::internal
