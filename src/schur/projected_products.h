#pragma once

#include <vector>

#include "linear/block_neighbors.h"
#include "linear/coarse_columns.h"
#include "linearize/incidences.h"
#include "linearize/product_plan.h"
#include "schur/elimination.h"
#include "schur/frame_aggregates.h"

namespace inceres::internal {

/// A V for the A = S + Λ_c of an elimination and the V of coarse columns, S formed or not:
///
///     (A V)_ia = Σ_{j∈a} (C + Λ_c)_ij V_j − Σ_l Y_liᵀ Z_la,   Z_la = Σ_{j∈a} Y_lj V_j
///
/// Without S that is the Schur complement of the projected problem: for each landmark and each
/// aggregate that sees it a block of a few columns. Cost: about as many flops as ten products of S
/// with a vector. Threads: the executor's, an aggregate a task; the same bits for any number.
class ProjectedProducts {
 public:
  /// blocks[k]: block k of the pattern of what is multiplied, S or C; null: zero.
  /// `without_S`: the elimination whose Y Yᵀ is to be subtracted; null where blocks are those of S.
  ProjectedProducts(const LandmarkIncidences& incidences, const FramePlans& plans,
                    std::vector<const double*> blocks, const Elimination* without_S);

  /// Writes A V of the columns; their shape is that of `reach`. `damping`: Λ_c, packed.
  void Form(const AggregateReach& reach, const double* damping, const Executor& executor,
            CoarseColumns* columns) const;

 private:
  struct Scratch;
  void FormAggregate(int aggregate, const AggregateReach& reach, const double* damping,
                     CoarseColumns* columns, Scratch* scratch) const;
  void AddFrameBlocks(int frame, int stride, const double* damping, CoarseColumns* columns,
                      const Scratch& scratch) const;
  void SubtractLandmark(int landmark, int aggregate, int stride, CoarseColumns* columns,
                        Scratch* scratch) const;

  const LandmarkIncidences& incidences_;
  const FramePlans& plans_;
  const std::vector<const double*> blocks_;
  const Elimination* const elimination_;
  const WholeRows rows_;  // without zero blocks
};

}  // namespace inceres::internal
