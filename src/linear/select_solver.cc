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

// Conjugate gradients with an earlier factor, beside a factorisation in each step: the iterations of a step, the share of the
// factorisations that is left, and the flops that reading an entry of S or of the factor is worth, some 6 GB/s. They win on a
// cathedral of 400 cameras (3,600 unknowns: 30 %), lose on one of 200 (15 %), and by far on paths of 1,000 and 10,000.
constexpr double kPcgIterations = 8.0;
constexpr double kPcgFactorisations = 0.4;
constexpr double kFlopsPerEntryRead = 22.0;

double Fill(const BlockPattern& pattern) {
  const auto n = static_cast<double>(pattern.size());
  return static_cast<double>(pattern.value_begin.back()) / (0.5 * n * (n + 1.0));
}

// A solver that factors, analysed.
struct Direct {
  std::unique_ptr<ReducedSolver> solver;
  double flops = 0.0;    // of a factorisation, those of a sparse one multiplied by how much longer they take
  double entries = 0.0;  // of the factor
};

Direct MakeDense(const BlockPattern& pattern, const Executor& executor, Status* status) {
  auto dense = std::make_unique<DenseCholesky>(executor);
  *status = dense->Analyze(pattern);
  const auto n = static_cast<double>(pattern.size());
  const double flops = kFlopsPerDenseEntry * 0.5 * n * n + dense->PredictedFlops();
  const double entries = dense->PredictedEntries();
  return {std::move(dense), flops, entries};
}

Direct MakeSparse(const BlockPattern& pattern, Status* status) {
  auto sparse = std::make_unique<SparseCholesky>();
  *status = sparse->Analyze(pattern);
  const bool supernodal = sparse->IsSupernodal() && pattern.size() >= kMinSupernodalSize;
  const double penalty = supernodal ? kSupernodalPenalty : kSimplicialPenalty;
  const double flops = status->ok() ? penalty * sparse->PredictedFlops() : std::numeric_limits<double>::infinity();
  const double entries = sparse->PredictedEntries();
  return {std::move(sparse), flops, entries};
}

Direct MakeCheaper(const BlockPattern& pattern, const Executor& executor, Status* status) {
  if (pattern.size() <= kAlwaysDenseSize || (pattern.size() < kNeverDenseSize && Fill(pattern) >= kAlwaysDenseFill)) {
    return MakeDense(pattern, executor, status);
  }
  Direct sparse = MakeSparse(pattern, status);
  // Where there is no sparse factor at all, the dense one may take more memory. Ordering for it costs less than clearing it, so
  // that it is asked only where it may win.
  const int largest_dense = status->ok() ? kMostlyZerosSize : kNeverDenseSize;
  const auto n = static_cast<double>(pattern.size());
  if (pattern.size() < largest_dense && kFlopsPerDenseEntry * 0.5 * n * n < sparse.flops) {
    Status dense_status;
    Direct dense = MakeDense(pattern, executor, &dense_status);
    if (dense.flops < sparse.flops) {
      *status = dense_status;
      return dense;
    }
  }
  return sparse;
}

// An iteration reads S once and the factor twice.
bool PcgIsCheaper(const Direct& direct, const BlockPattern& pattern) {
  const double iteration = kFlopsPerEntryRead * (static_cast<double>(pattern.value_begin.back()) + 2.0 * direct.entries);
  return kPcgIterations * iteration < (1.0 - kPcgFactorisations) * direct.flops;
}

}  // namespace

std::unique_ptr<ReducedSolver> MakeReducedSolver(ReducedSolverKind kind, const ReducedSolverFactory& factory,
                                                 const BlockPattern& pattern, const Executor& executor, Status* status) {
  if (factory) {
    std::unique_ptr<ReducedSolver> custom = factory();
    *status = custom != nullptr
                  ? custom->Analyze(pattern)
                  : Status::Error(StatusCode::kInvalidArgument, "SolverOptions::reduced_solver_factory returned null");
    return custom;
  }
  switch (kind) {
    case ReducedSolverKind::kDense:
      return MakeDense(pattern, executor, status).solver;
    case ReducedSolverKind::kSparse:
      return MakeSparse(pattern, status).solver;
    case ReducedSolverKind::kAutomatic:
      return MakeCheaper(pattern, executor, status).solver;
    case ReducedSolverKind::kPcg:
    case ReducedSolverKind::kAutomaticInexact:
      break;
  }
  Direct direct = MakeCheaper(pattern, executor, status);
  if (kind == ReducedSolverKind::kAutomaticInexact && !PcgIsCheaper(direct, pattern)) {
    return std::move(direct.solver);
  }
  return std::make_unique<LaggedPcg>(executor, pattern, std::move(direct.solver));
}

}  // namespace inceres::internal
