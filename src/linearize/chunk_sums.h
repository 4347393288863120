#pragma once

#include <cstdint>
#include <vector>

#include "linearize/product_plan.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// C = Σ J_iᵀJ_j of the frames, its diagonal, and Jᵀf, from Jacobians that come in chunks: each
/// block goes on where the chunk before has left it. A block is added to by one task, in the order
/// of the records: the bits do not depend on the number of threads.
class ChunkSums {
 public:
  /// After JacobianChunks::Cut, of plans whose terms ascend by record.
  ChunkSums(const Evaluator& evaluator, const FramePlans& plans);

  /// Adds what the chunk that is in memory has; chunk 0 begins. `begin`: per block of the pattern,
  /// where it begins in C; -1: C has none.
  void Add(int chunk, const std::vector<std::int64_t>& begin, double* C, double* gradient,
           double* diagonal);

 private:
  void Begin(std::size_t block, double* C, double* gradient, double* diagonal);
  bool HasCome(int chunk, int segment, int term) const;
  bool HasTerms(int chunk, std::size_t block) const;
  void AddTerms(int chunk, std::size_t block, double* sum, double* g);
  void AddToBlock(int chunk, std::size_t block, double* C, double* gradient, double* diagonal);

  const Evaluator& evaluator_;
  const FramePlans& plans_;
  const Kernels& kernels_;
  std::vector<int> next_term_;  // per segment of the plan
};

}  // namespace inceres::internal
