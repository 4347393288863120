#include "adapters/ceres/read/ordering.h"

#include <algorithm>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {

OrderingView ReadOrdering(const ceres::Solver::Options& options, const ProblemView& view) {
  OrderingView result;
  result.numbers_frames = options.linear_solver_type == ceres::ITERATIVE_SCHUR &&
                          IsByClusters(options.preconditioner_type);
  if (options.linear_solver_ordering == nullptr) {
    return result;
  }
  result.given = true;
  bool first = true;
  for (const auto& [group, elements] : options.linear_solver_ordering->group_to_elements()) {
    std::vector<int> blocks;
    int num_left = 0;
    for (const double* element : elements) {
      const int b = view.index.Find(element);
      result.has_unknown = result.has_unknown || b < 0;
      if (b >= 0 && view.IsReduced(b)) {
        blocks.push_back(b);
      }
      num_left += b < 0 || view.IsReduced(b) ? 1 : 0;
    }
    result.num_elements += num_left;
    if (num_left > 0) {
      if (result.group_sizes.empty()) {
        result.first_group = std::move(blocks);
      } else {
        result.later_groups.insert(result.later_groups.end(), blocks.begin(), blocks.end());
      }
      result.group_sizes.push_back(num_left);
    } else {
      result.first_group_emptied = result.first_group_emptied || first;
    }
    first = false;
  }
  return result;
}

std::vector<int> GroupSizes(const ceres::ParameterBlockOrdering* ordering) {
  std::vector<int> sizes;
  if (ordering != nullptr) {
    for (const auto& group : ordering->group_to_elements()) {
      sizes.push_back(static_cast<int>(group.second.size()));
    }
  }
  return sizes;
}

bool IsIndependentSet(const ProblemView& view, const std::vector<int>& blocks) {
  std::vector<char> in_set(view.blocks.size(), 0);
  for (const int b : blocks) {
    in_set[At(b)] = 1;
  }
  return std::all_of(view.residuals.begin(), view.residuals.end(),
                     [&](const ResidualBlockView& residual) {
                       const int* slots = view.SlotsOf(residual);
                       return std::count_if(slots, slots + residual.num_slots,
                                            [&](int b) { return in_set[At(b)] != 0; }) <= 1;
                     });
}

ceres::LinearSolverType EffectiveLinearSolver(const ceres::Solver::Options& options,
                                              const OrderingView& ordering) {
  if (ordering.first_group_emptied && options.linear_solver_type == ceres::DENSE_SCHUR) {
    return ceres::DENSE_QR;
  }
  if (ordering.first_group_emptied && options.linear_solver_type == ceres::SPARSE_SCHUR) {
    return ceres::SPARSE_NORMAL_CHOLESKY;
  }
  if (ordering.first_group_emptied && options.linear_solver_type == ceres::ITERATIVE_SCHUR) {
    return ceres::CGNR;
  }
  return options.linear_solver_type;
}

ceres::PreconditionerType PreconditionerFor(ceres::PreconditionerType given,
                                            ceres::LinearSolverType given_type,
                                            ceres::LinearSolverType effective_type) {
  const bool switched = given_type == ceres::ITERATIVE_SCHUR && effective_type == ceres::CGNR;
  return switched && given != ceres::IDENTITY ? ceres::JACOBI : given;
}

ceres::LinearSolverType TypeToPlanFor(const ceres::Solver::Options& options,
                                      const OrderingView& ordering) {
  const ceres::LinearSolverType type = EffectiveLinearSolver(options, ordering);
  return options.dynamic_sparsity && !IsIterative(type) ? ceres::DENSE_QR : type;
}

ceres::LinearSolverType TypeToPlanIncrementally(const ceres::Solver::Options& options,
                                                const OrderingView& ordering) {
  const ceres::LinearSolverType type = IncrementalLinearSolver(options, ordering);
  if (type == ceres::ITERATIVE_SCHUR) {
    return ceres::SPARSE_SCHUR;
  }
  return type == ceres::CGNR ? ceres::SPARSE_NORMAL_CHOLESKY : type;
}

ceres::LinearSolverType IncrementalLinearSolver(const ceres::Solver::Options& options,
                                                const OrderingView& ordering) {
  const ceres::LinearSolverType type = EffectiveLinearSolver(options, ordering);
  return type == ceres::DENSE_QR ? ceres::DENSE_NORMAL_CHOLESKY : type;
}

}  // namespace inceres::internal
