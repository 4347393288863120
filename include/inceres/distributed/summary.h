#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "inceres/solver/summary.h"

namespace inceres {

/// What one rank had to do.
struct RankReport {
  std::int64_t num_factors = 0;          ///< of its graph
  std::int64_t num_landmarks = 0;        ///< that move
  std::int64_t num_frames = 0;           ///< that its factors touch and that move
  std::int64_t num_shared_frames = 0;    ///< of them those that other ranks' factors touch too
  std::int64_t num_owned_frames = 0;     ///< whose rows it sums
  std::int64_t bytes = 0;                ///< of the solver's arrays
  std::int64_t peak_resident_bytes = 0;  ///< of the process, so far; 0 where that is not known
  /// of a product with S: what it sends to others, by the plan; and of the reductions of an
  /// iteration of conjugate gradients, what it has for all others
  std::int64_t exchange_bytes_per_product = 0;
  /// values of the frames it shares: what exchange_bytes_per_product compares with
  std::int64_t shared_frame_bytes = 0;
  std::int64_t num_products = 0;  ///< with S
  /// from the begin of the iterations to their end, in messages to one other rank: of frames, as
  /// PETSc counts them, of blocks of S that is formed, of the two-level preconditioner
  std::int64_t bytes_sent = 0;
  std::int64_t reduction_bytes_sent = 0;  ///< in reductions, which are gatherings of a few numbers
  double seconds = 0.0;                   ///< of the whole solve
  double product_seconds = 0.0;           ///< of it in products with S
  double exchange_seconds = 0.0;          ///< of it in messages, waiting included
  double reduction_seconds = 0.0;         ///< of it in reductions, waiting included
};

/// What happened, the same on all ranks but for times and bytes of `solve`, which are each rank's
/// own.
struct DistributedSummary {
  /// Sizes are those of all ranks together; num_variables and num_values count a frame once for
  /// each rank that lists it.
  Summary solve;
  std::vector<RankReport> ranks;  ///< of all ranks, by number
  /// Largest number of factors of a rank over the mean; 1: all have as many.
  double imbalance = 1.0;
  int num_checkpoints = 0;  ///< written
  /// Why the last checkpoint that could not be written was not: the solve went on without it. Empty
  /// if there was none.
  std::string checkpoint_failure;
};

}  // namespace inceres
