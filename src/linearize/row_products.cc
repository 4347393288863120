#include "linearize/row_products.h"

#include <algorithm>

namespace inceres::internal {

// L(0) − L(δ) = −(Jδ)ᵀ(f + ½ Jδ), row by row (docs/algorithms.md, "Step quality"). The form ηᵀδ −
// ½ δᵀHδ would be a difference of numbers that agree to many digits near the minimum, where only
// its sign matters. The same pass gives ‖Jδ‖², the curvature along δ. Sums run over fixed chunks
// and these in their order: the bits are those of one thread.

RowProducts JacobianProduct::Multiply(const double* v) {
  constexpr int kChunkSize = 1024;
  // zeros, where Pad leaves them
  padded_.resize(static_cast<std::size_t>(evaluator_.layout().quad_offset.back()) * kQuad);
  // Whole rows are packed themselves.
  if (evaluator_.storage() == JacobianStorage::kWholeRows) {
    std::copy_n(v, evaluator_.layout().size(), padded_.data());
  } else {
    evaluator_.layout().Pad(v, padded_.data());
  }
  const Kernels& kernels = BestKernels();
  RowProducts total;
  for (const Linearization& cache : evaluator_.families()) {
    const int num_chunks = (cache.num_blocks() + kChunkSize - 1) / kChunkSize;
    partial_.resize(num_chunks);
    evaluator_.executor().For(num_chunks, 1, [&](int begin, int end) {
      for (int chunk = begin; chunk < end; ++chunk) {
        const int first = chunk * kChunkSize;
        partial_[chunk] = kernels.row_products(
            cache.Rows(first, std::min(first + kChunkSize, cache.num_blocks())), padded_.data());
      }
    });
    // In the order of the chunks, not of the tasks.
    for (const RowProducts& chunk : partial_) {
      total.model_decrease += chunk.model_decrease;
      total.squared_norm += chunk.squared_norm;
    }
  }
  return total;
}

}  // namespace inceres::internal
