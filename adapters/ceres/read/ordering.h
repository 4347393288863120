#pragma once

#include <vector>

#include <ceres/solver.h>

#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// The user's linear_solver_ordering after the blocks that Ceres removes (constant, untouched) are
/// gone. The caller's object is only read; stock Ceres edits it.
struct OrderingView {
  bool given = false;
  int num_elements = 0;      ///< what is left, addresses that are no parameter block included
  bool has_unknown = false;  ///< some address is no parameter block of the problem
  bool first_group_emptied = false;  ///< removal emptied the lowest group
  std::vector<int> group_sizes;      ///< of the groups left, by increasing id
  std::vector<int> first_group;      ///< block indices of the lowest group left
  std::vector<int> later_groups;     ///< those of the others, by increasing id, then by address
  /// The order of frames matters: to preconditioners by clusters, in which it breaks ties.
  bool numbers_frames = false;
};

/// Whether it keeps blocks of S within clusters of frames.
inline bool IsByClusters(ceres::PreconditionerType type) {
  return type == ceres::CLUSTER_JACOBI || type == ceres::CLUSTER_TRIDIAGONAL;
}

OrderingView ReadOrdering(const ceres::Solver::Options& options, const ProblemView& view);

/// Whether no two of these blocks share a residual block.
bool IsIndependentSet(const ProblemView& view, const std::vector<int>& blocks);

/// Group sizes of an ordering by increasing id; empty for null.
std::vector<int> GroupSizes(const ceres::ParameterBlockOrdering* ordering);

/// Whether Ceres would solve for each step by conjugate gradients.
inline bool IsIterative(ceres::LinearSolverType type) {
  return type == ceres::ITERATIVE_SCHUR || type == ceres::CGNR;
}

/// The type Ceres would end up with: a Schur type whose first group was emptied becomes the type
/// without elimination.
ceres::LinearSolverType EffectiveLinearSolver(const ceres::Solver::Options& options,
                                              const OrderingView& ordering);

/// The preconditioner Ceres would end up with: one that needs a Schur complement is JACOBI where
/// there is none any more.
ceres::PreconditionerType PreconditionerFor(ceres::PreconditionerType given,
                                            ceres::LinearSolverType given_type,
                                            ceres::LinearSolverType effective_type);

/// The type by which landmarks are chosen: with dynamic_sparsity, as for a QR factorization, none
/// are, for it is the zeros of each linearization that say what is coupled.
ceres::LinearSolverType TypeToPlanFor(const ceres::Solver::Options& options,
                                      const OrderingView& ordering);

/// The type by which landmarks are chosen in incremental mode, where conjugate gradients solve the
/// same system as a direct solver.
ceres::LinearSolverType TypeToPlanIncrementally(const ceres::Solver::Options& options,
                                                const OrderingView& ordering);

/// The effective type in incremental mode, which forms normal equations: for who asked for
/// DENSE_SCHUR that is what he gets where Ceres takes DENSE_QR (a window whose landmarks are all
/// held, say).
ceres::LinearSolverType IncrementalLinearSolver(const ceres::Solver::Options& options,
                                                const OrderingView& ordering);

}  // namespace inceres::internal
