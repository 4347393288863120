#include "linear/select_solver.h"

#include <limits>

#include "linear/dense_cholesky.h"
#include "linear/lagged_pcg.h"
#include "linear/sparse_cholesky.h"

namespace inceres::internal {
namespace {

// Measured on S of BAL and pose-graph problems: below this size, or above this share of blocks present, the sparse factor never
// wins.
constexpr int kAlwaysDenseSize = 300;
constexpr double kAlwaysDenseFill = 0.5;
// Beyond this the dense matrix alone would take gigabytes.
constexpr int kNeverDenseSize = 12000;
// Beyond this, 128 MB of a dense matrix that is mostly zeros, speed would have to be much better than it is.
constexpr int kMostlyZerosSize = 4000;
// At equal predicted flops the sparse factor takes this much longer, on one thread. With supernodes it reaches 8 to 14 GFlop/s
// where the dense kernels reach 13 to 20 (paths of 100 to 1,200 cameras; break-even at 3,600 unknowns with loops, at 1,800
// without); where CHOLMOD finds supernodes not worth it, or they are those of a window, 1 GFlop/s.
constexpr double kSupernodalPenalty = 1.4;
constexpr int kMinSupernodalSize = 1000;
constexpr double kSimplicialPenalty = 15.0;
// Flops that an entry of the dense matrix is worth before any arithmetic: it is cleared, at some 10 GB/s. Without it thin bands
// would go to the dense kernels, which leave out what stays zero.
constexpr double kFlopsPerDenseEntry = 12.0;

double Fill(const BlockPattern& pattern) {
  const auto n = static_cast<double>(pattern.size());
  return static_cast<double>(pattern.value_begin.back()) / (0.5 * n * (n + 1.0));
}

}  // namespace

std::unique_ptr<ReducedSolver> MakeReducedSolver(ReducedSolverKind kind, const ReducedSolverFactory& factory,
                                                 const BlockPattern& pattern, const Executor& executor, Status* status) {
  const auto analysed = [&](std::unique_ptr<ReducedSolver> solver) {
    *status = solver->Analyze(pattern);
    return solver;
  };
  if (factory) {
    std::unique_ptr<ReducedSolver> custom = factory();
    if (custom == nullptr) {
      *status = Status::Error(StatusCode::kInvalidArgument, "SolverOptions::reduced_solver_factory returned null");
      return nullptr;
    }
    return analysed(std::move(custom));
  }
  const bool clearly_dense =
      pattern.size() <= kAlwaysDenseSize || (pattern.size() < kNeverDenseSize && Fill(pattern) >= kAlwaysDenseFill);
  if (kind == ReducedSolverKind::kDense || (kind == ReducedSolverKind::kAutomatic && clearly_dense)) {
    return analysed(std::make_unique<DenseCholesky>(executor));
  }
  if (kind == ReducedSolverKind::kPcg) {
    return analysed(std::make_unique<LaggedPcg>(executor));
  }
  auto sparse = std::make_unique<SparseCholesky>();
  *status = sparse->Analyze(pattern);
  const auto n = static_cast<double>(pattern.size());
  const double fixed_flops = kFlopsPerDenseEntry * 0.5 * n * n;
  // Ordering for the dense factor costs less than this too, so that it is asked only where it may win.
  const bool supernodal = sparse->IsSupernodal() && pattern.size() >= kMinSupernodalSize;
  const double penalty = supernodal ? kSupernodalPenalty : kSimplicialPenalty;
  const double sparse_flops = status->ok() ? penalty * sparse->PredictedFlops() : std::numeric_limits<double>::infinity();
  // Where there is no sparse factor at all, the dense one may take more memory.
  const int largest_dense = status->ok() ? kMostlyZerosSize : kNeverDenseSize;
  if (kind == ReducedSolverKind::kAutomatic && pattern.size() < largest_dense && fixed_flops < sparse_flops) {
    auto dense = std::make_unique<DenseCholesky>(executor);
    const Status dense_status = dense->Analyze(pattern);
    if (fixed_flops + dense->PredictedFlops() < sparse_flops) {
      *status = dense_status;
      return dense;
    }
  }
  return sparse;
}

}  // namespace inceres::internal
