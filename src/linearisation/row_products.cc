#include "linearisation/row_products.h"

#include <algorithm>

namespace inceres::internal {

RowProducts MultiplyJacobian(const Evaluator& evaluator, const double* v) {
  constexpr int kChunkSize = 1024;
  AlignedVector<double> padded(static_cast<std::size_t>(evaluator.layout().quad_offset.back()) * kQuad);
  evaluator.layout().Pad(v, padded.data());
  const Kernels& kernels = BestKernels();
  RowProducts total;
  for (const FamilyCache& cache : evaluator.families()) {
    const int num_chunks = (cache.num_factors + kChunkSize - 1) / kChunkSize;
    std::vector<RowProducts> partial(num_chunks);
    evaluator.executor().For(num_chunks, 1, [&](int begin, int end) {
      for (int chunk = begin; chunk < end; ++chunk) {
        const int first = chunk * kChunkSize;
        partial[chunk] = kernels.row_products(cache.Rows(first, std::min(first + kChunkSize, cache.num_factors)), padded.data());
      }
    });
    for (const RowProducts& chunk : partial) {
      total.model_decrease += chunk.model_decrease;
      total.squared_norm += chunk.squared_norm;
    }
  }
  return total;
}

}  // namespace inceres::internal
