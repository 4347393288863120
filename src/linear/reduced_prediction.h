#pragma once

#include "inceres/export.h"
#include "inceres/linear/reduced_solver.h"
#include "inceres/status.h"

namespace inceres::internal {

/// What the solver that ReducedSolverKind::kAutomatic stands for would take.
struct ReducedPrediction {
  double cost = 0.0;   ///< of a factorization, in flops of the dense Cholesky that take as long
  double bytes = 0.0;  ///< values of S included
};

/// Cost: that of the symbolic analysis, half a microsecond a block of S, where S is neither small
/// nor full. Fails as that does.
INCERES_EXPORT Status PredictReducedSolver(const BlockPattern& pattern,
                                           ReducedPrediction* prediction);

/// The same for a full S with so many unknowns.
INCERES_EXPORT ReducedPrediction PredictFullSystem(double size);

/// The same, as an upper bound, for an S of which an order is known in which its rows are full from
/// their first entry to the diagonal, at most.
class EnvelopeCost {
 public:
  /// Rows of one block row: its blocks, its entries from the first one on, and how many rows.
  void AddRows(int num_blocks, int num_entries, int num_rows);
  /// Of all rows that were added.
  ReducedPrediction prediction() const;

 private:
  double flops_ = 0.0;
  double blocks_ = 0.0;
  double entries_ = 0.0;
};

/// Whether kAutomatic takes the dense solver for an S of this size, of which this share is there.
INCERES_EXPORT bool IsSolvedDensely(double size, double fill);
/// The share of S that is there.
double FillOf(const BlockPattern& pattern);

}  // namespace inceres::internal
