#include "linear/select_solver.h"

#include <utility>

#include "linear/automatic_solver.h"
#include "linear/dense_cholesky.h"
#include "linear/lagged_pcg.h"
#include "linear/path_cholesky.h"
#include "linear/reduced_prediction.h"
#include "linear/resumed_solver.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

// Which reduced solver a solve gets. In a batch solve the pattern is known, so the choice is made
// once, by predicted cost, and the solver comes analyzed. An incremental solve has no pattern yet:
// its automatic solver chooses call by call. A factory of the user goes before all of it.
//
// Conjugate gradients with an earlier factor still factor now and then, so they win only where a
// product with S, and one with the factor, is far cheaper than a factorization: large systems with
// much fill.

namespace {

// Conjugate gradients with an earlier factor, beside a factorization in each step: the iterations
// of a step, the share of the factorizations that is left, and the flops that reading an entry of S
// or of the factor is worth, some 6 GB/s. They win on a cathedral of 400 cameras (3,600 unknowns:
// 30 %), lose on one of 200 (15 %), and by far on paths of 1,000 and 10,000.
constexpr double kPcgIterations = 8.0;
constexpr double kPcgFactorizations = 0.4;
constexpr double kFlopsPerEntryRead = 22.0;

// A solver that factors, analyzed.
struct Direct {
  std::unique_ptr<ReducedSolver> solver;
  double flops = 0.0;    // of a factorization
  double entries = 0.0;  // of the factor
};

// A solver and what its analysis predicts. The matrix has no values at this time.
template <typename Solver>
Direct Make(const BlockPattern& pattern, const Executor& executor, Status* status) {
  auto solver = std::make_unique<Solver>(executor);
  *status = solver->Analyze(ReducedMatrix(pattern, nullptr, nullptr));
  const double flops = solver->PredictedFlops(), entries = solver->PredictedEntries();
  return {std::move(solver), flops, entries};
}

// Paths first where S has many, and nobody has said in which order.
Direct MakeSparse(const BlockPattern& pattern, const Executor& executor, Status* status) {
  BlockPaths paths = pattern.groups.empty() ? FindBlockPaths(pattern) : BlockPaths();
  if (!AreWorthEliminating(paths)) {
    return Make<SparseCholesky>(pattern, executor, status);
  }
  auto solver = std::make_unique<PathCholesky>(executor);
  *status = solver->Analyze(pattern, std::move(paths));
  const double flops = solver->PredictedFlops(), entries = solver->PredictedEntries();
  return {std::move(solver), flops, entries};
}

Direct MakeCheaper(const BlockPattern& pattern, const Executor& executor, Status* status) {
  const bool dense = IsSolvedDensely(pattern.size(), FillOf(pattern));
  return dense ? Make<DenseCholesky>(pattern, executor, status)
               : MakeSparse(pattern, executor, status);
}

// An iteration reads S once and the factor twice.
bool PcgIsCheaper(const Direct& direct, const BlockPattern& pattern) {
  // Reading is what an iteration costs: it takes two flops for each entry read.
  const double iteration =
      kFlopsPerEntryRead * (static_cast<double>(pattern.value_begin.back()) + 2.0 * direct.entries);
  return kPcgIterations * iteration < (1.0 - kPcgFactorizations) * direct.flops;
}

std::unique_ptr<ReducedSolver> MakeCustom(const ReducedSolverFactory& factory,
                                          const BlockPattern& pattern, Status* status) {
  std::unique_ptr<ReducedSolver> custom = factory();
  *status = custom != nullptr
                ? custom->Analyze(ReducedMatrix(pattern, nullptr, nullptr))
                : Status::Error(StatusCode::kInvalidArgument,
                                "SolverOptions::reduced_solver_factory returned null");
  return custom;
}

}  // namespace

std::unique_ptr<ReducedSolver> MakeReducedSolver(ReducedSolverKind kind,
                                                 const ReducedSolverFactory& factory,
                                                 const BlockPattern& pattern,
                                                 const Executor& executor, Status* status) {
  if (factory) {
    return MakeCustom(factory, pattern, status);
  }
  switch (kind) {
    case ReducedSolverKind::kDense:
      return Make<DenseCholesky>(pattern, executor, status).solver;
    case ReducedSolverKind::kSparse:
      return MakeSparse(pattern, executor, status).solver;
    case ReducedSolverKind::kAutomatic:
    case ReducedSolverKind::kResumed:  // SolverOptions::Validate refuses it
      return MakeCheaper(pattern, executor, status).solver;
    case ReducedSolverKind::kPcg:
    case ReducedSolverKind::kAutomaticInexact:
      break;
  }
  // The factor that PCG is preconditioned by is the one that would have solved the system.
  Direct direct = MakeCheaper(pattern, executor, status);
  if (kind == ReducedSolverKind::kAutomaticInexact && !PcgIsCheaper(direct, pattern)) {
    return std::move(direct.solver);
  }
  return std::make_unique<LaggedPcg>(std::move(direct.solver));
}

std::unique_ptr<ReducedSolver> MakeResumingSolver(ReducedSolverKind kind,
                                                  const ReducedSolverFactory& factory,
                                                  const PcgOptions& pcg, const Executor& executor) {
  if (factory) {
    return factory();
  }
  switch (kind) {
    case ReducedSolverKind::kResumed:
      return std::make_unique<ResumedSolver>();
    case ReducedSolverKind::kDense:
      return std::make_unique<DenseCholesky>(executor);
    case ReducedSolverKind::kSparse:
      return std::make_unique<SparseCholesky>(executor);
    case ReducedSolverKind::kPcg:
      return std::make_unique<PcgSolver>(pcg);
    default:
      return std::make_unique<AutomaticSolver>(executor);
  }
}

}  // namespace inceres::internal
