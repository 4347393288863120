#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/status.h"

namespace inceres {

/// Where the blocks of the symmetric reduced matrix S are: the lower triangle, block rows in order, columns ascending within a
/// row, the diagonal block always present and last in its row. Block (i, j) is d_i × d_j, row-major, without padding, at
/// values[value_begin[k]]; of a diagonal block the whole square is stored.
struct BlockPattern {
  std::vector<int> offsets;                ///< first scalar row of each block row; one more entry than blocks: the total size
  std::vector<int> row_begin;              ///< blocks of row i are [row_begin[i], row_begin[i + 1])
  std::vector<int> columns;                ///< block column of each block
  std::vector<std::int64_t> value_begin;   ///< offset of each block's values; one more entry: the total count

  int num_blocks() const { return static_cast<int>(offsets.size()) - 1; }
  int size() const { return offsets.back(); }
  int block_size(int i) const { return offsets[static_cast<std::size_t>(i) + 1] - offsets[static_cast<std::size_t>(i)]; }
};

/// The open interface for S δ = b. The built-in solvers (dense Cholesky, CHOLMOD) implement it; implement it to plug in your own and
/// hand a factory to SolverOptions::reduced_solver_factory. See docs/reduced_solver.md for a worked example.
///
/// Call order: Analyze once per pattern, then any number of Factorize, each followed by any number of Solve. One thread calls.
class INCERES_EXPORT ReducedSolver {
 public:
  virtual ~ReducedSolver() = default;

  /// Shown in summaries and error messages, for example "dense Cholesky".
  virtual const char* Name() const = 0;

  /// Announces a pattern. It stays alive and unchanged until the next Analyze: symbolic work belongs here.
  virtual Status Analyze(const BlockPattern& pattern) = 0;

  /// Factors S + diag(diagonal). `values` are laid out by the pattern, `diagonal` has pattern.size() entries ≥ 0. Returns
  /// StatusCode::kSingular when the matrix is not positive definite; the solver then retries with more damping.
  virtual Status Factorize(const double* values, const double* diagonal) = 0;

  /// x = (S + diag(diagonal))⁻¹ b; pattern.size() entries each, not aliased.
  virtual Status Solve(const double* b, double* x) = 0;
};

using ReducedSolverFactory = std::function<std::unique_ptr<ReducedSolver>()>;

}  // namespace inceres
