#include "linear/select_live_solver.h"

#include "linear/automatic_solver.h"
#include "linear/dense_cholesky.h"

namespace inceres::internal {

std::unique_ptr<LiveReducedSolver> MakeLiveReducedSolver(LiveReducedSolverKind kind, const PcgOptions& pcg,
                                                         const Executor& executor) {
  switch (kind) {
    case LiveReducedSolverKind::kResumed:
      return std::make_unique<ResumedSolver>();
    case LiveReducedSolverKind::kDense:
      return std::make_unique<BatchSolver<DenseCholesky>>(executor);
    case LiveReducedSolverKind::kSparse:
      return std::make_unique<BatchSolver<SparseCholesky>>();
    case LiveReducedSolverKind::kPcg:
      return std::make_unique<PcgSolver>(pcg);
    default:
      return std::make_unique<AutomaticSolver>();
  }
}

}  // namespace inceres::internal
