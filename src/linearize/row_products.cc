#include "linearize/row_products.h"

#include <algorithm>
#include <limits>

#include "linearize/incidences.h"
#include "linearize/jacobian_chunks.h"

namespace inceres::internal {

// L(0) − L(δ) = −(Jδ)ᵀ(f + ½ Jδ), row by row (docs/algorithms.md, "Step quality"). The form ηᵀδ −
// ½ δᵀHδ would be a difference of numbers that agree to many digits near the minimum, where only
// its sign matters. The same pass gives ‖Jδ‖², the curvature along δ. Sums run over fixed chunks
// and these in their order: the bits are those of one thread.

// Where Jacobians are not kept each chunk is evaluated once more, by the same calls as before: that
// fails only where a cost function is not the same function the second time.
RowProducts JacobianProduct::Multiply(const double* v) {
  RowProducts total;
  JacobianChunks* const chunks = evaluator_.jacobian_chunks();
  // zeros, where Pad leaves them
  padded_.resize(static_cast<std::size_t>(evaluator_.layout().quad_offset.back()) * kQuad);
  // Whole rows are packed themselves.
  if (evaluator_.storage() == JacobianStorage::kWholeRows) {
    std::copy_n(v, evaluator_.layout().size(), padded_.data());
  } else {
    evaluator_.layout().Pad(v, padded_.data());
  }
  for (int chunk = 0; chunks != nullptr && chunk < chunks->num_chunks(); ++chunk) {
    if (!chunks->Bring(chunk).ok()) {
      constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
      return {kNone, kNone};
    }
    AddChunk(chunk, &total);
  }
  for (const Linearization& cache : evaluator_.families()) {
    if (chunks == nullptr) {
      AddRows(cache, 0, cache.num_blocks(), &total);
    }
  }
  return total;
}

// Family by family, of each the records that the chunk has.
void JacobianProduct::AddChunk(int chunk, RowProducts* total) {
  const JacobianChunks& chunks = *evaluator_.jacobian_chunks();
  for (const Linearization& cache : evaluator_.families()) {
    AddRows(cache, chunks.Begin(chunk, cache.id), chunks.End(chunk, cache.id), total);
  }
}

// For the way back, which finds the landmarks' steps chunk by chunk: frames are there from the
// beginning and are padded with the first chunk, landmarks with their own. A factor's landmark lies
// in the factor's chunk, so no entry is read before it is there. Behind the landmarks' chunks
// everything is.
void JacobianProduct::AddChunk(int chunk, const LandmarkIncidences& incidences, const double* v,
                               RowProducts* total) {
  const Layout& layout = evaluator_.layout();
  padded_.resize(static_cast<std::size_t>(layout.quad_offset.back()) * kQuad);
  if (chunk == 0) {
    layout.Pad(v, 0, layout.num_frames, padded_.data());
  }
  if (chunk < incidences.num_chunks()) {
    layout.Pad(v, layout.num_frames + incidences.chunk_begin[chunk],
               layout.num_frames + incidences.chunk_begin[chunk + 1], padded_.data());
  }
  AddChunk(chunk, total);
}

// Chunks of 1,024 records count from `begin`, which the problem decides, so the sums are the same
// for any number of threads. Each task writes the sums of its own chunks.
void JacobianProduct::AddRows(const Linearization& cache, int begin, int end, RowProducts* total) {
  constexpr int kChunkSize = 1024;
  const Kernels& kernels = BestKernels();
  const int num_chunks = (end - begin + kChunkSize - 1) / kChunkSize;
  partial_.resize(num_chunks);
  evaluator_.executor().For(num_chunks, 1, [&](int first_chunk, int end_chunk) {
    for (int chunk = first_chunk; chunk < end_chunk; ++chunk) {
      const int first = begin + chunk * kChunkSize;
      partial_[chunk] = kernels.row_products(cache.Rows(first, std::min(first + kChunkSize, end)),
                                             padded_.data());
    }
  });
  // In the order of the chunks, not of the tasks.
  for (const RowProducts& chunk : partial_) {
    total->model_decrease += chunk.model_decrease;
    total->squared_norm += chunk.squared_norm;
  }
}

}  // namespace inceres::internal
