#include "linear/select_incremental_solver.h"

#include <cstddef>
#include <utility>

#include "linear/automatic_solver.h"
#include "linear/dense_cholesky.h"

namespace inceres::internal {
namespace {

// The user's own.
class FactorySolver {
 public:
  explicit FactorySolver(std::unique_ptr<ReducedSolver> solver) : solver_(std::move(solver)) {}

  const char* Name() const { return solver_ == nullptr ? "none" : solver_->Name(); }
  Status Analyze(const BlockPattern& pattern) {
    return solver_ == nullptr
               ? Status::Error(StatusCode::kInvalidArgument, "IncrementalOptions::reduced_solver_factory returned null")
               : solver_->Analyze(pattern);
  }
  Status Factorize(const double* values, const double* diagonal) { return solver_->Factorize(values, diagonal); }
  Status Solve(const double* b, double* x) { return solver_->Solve(b, x); }
  // Not known.
  double PredictedFlops() const { return 0.0; }
  std::size_t Bytes() const { return 0; }

 private:
  std::unique_ptr<ReducedSolver> solver_;
};

}  // namespace

std::unique_ptr<IncrementalReducedSolver> MakeIncrementalReducedSolver(ReducedSolverKind kind,
                                                                       const ReducedSolverFactory& factory, const PcgOptions& pcg,
                                                                       const Executor& executor) {
  if (factory) {
    return std::make_unique<BatchSolver<FactorySolver>>(factory());
  }
  switch (kind) {
    case ReducedSolverKind::kResumed:
      return std::make_unique<ResumedSolver>();
    case ReducedSolverKind::kDense:
      return std::make_unique<BatchSolver<DenseCholesky>>(executor);
    case ReducedSolverKind::kSparse:
      return std::make_unique<BatchSolver<SparseCholesky>>(executor);
    case ReducedSolverKind::kPcg:
      return std::make_unique<PcgSolver>(pcg);
    default:
      return std::make_unique<AutomaticSolver>(executor);
  }
}

}  // namespace inceres::internal
