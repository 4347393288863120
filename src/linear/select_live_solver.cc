#include "linear/select_live_solver.h"

#include "linear/batch_solver.h"
#include "linear/dense_cholesky.h"
#include "linear/resumed_solver.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {

std::unique_ptr<LiveReducedSolver> MakeLiveReducedSolver(LiveReducedSolverKind kind, const Executor& executor) {
  switch (kind) {
    case LiveReducedSolverKind::kDense:
      return std::make_unique<BatchSolver<DenseCholesky>>(executor);
    case LiveReducedSolverKind::kSparse:
      return std::make_unique<BatchSolver<SparseCholesky>>();
    default:
      return std::make_unique<ResumedSolver>();
  }
}

}  // namespace inceres::internal
