#include "linearize/chunk_sums.h"

#include <algorithm>

#include "linearize/block_scratch.h"

namespace inceres::internal {

// The frames' half of H from Jacobians in chunks (docs/algorithms.md, "Linearization"). The plan of
// products is that of Jacobians that are kept; of each of its segments the chunk has a run of
// terms, behind those of the chunk before.

namespace {

constexpr int kGrain = 64;  // blocks: most have no term in a chunk

}  // namespace

ChunkSums::ChunkSums(const Evaluator& evaluator, const FramePlans& plans)
    : evaluator_(evaluator),
      plans_(plans),
      kernels_(BestKernels()),
      next_term_(plans.hessian.segments.size()) {
}

void ChunkSums::Add(int chunk, const std::vector<std::int64_t>& begin, double* C, double* gradient,
                    double* diagonal) {
  evaluator_.executor().For(static_cast<int>(plans_.block_row.size()), kGrain,
                            [&](int first, int last) {
                              for (auto block = static_cast<std::size_t>(first);
                                   block < static_cast<std::size_t>(last); ++block) {
                                if (begin[block] < 0) {
                                  continue;
                                }
                                if (chunk == 0) {
                                  Begin(block, C + begin[block], gradient, diagonal);
                                }
                                if (HasTerms(chunk, block)) {
                                  AddToBlock(chunk, block, C + begin[block], gradient, diagonal);
                                }
                              }
                            });
}

void ChunkSums::Begin(std::size_t block, double* C, double* gradient, double* diagonal) {
  const BlockPattern& pattern = plans_.pattern;
  const int row = plans_.block_row[block];
  std::fill_n(C, pattern.block_size(row) * pattern.block_size(pattern.columns[block]), 0.0);
  std::fill(next_term_.begin() + plans_.hessian.segments_begin[block],
            next_term_.begin() + plans_.hessian.segments_begin[block + 1], 0);
  if (pattern.columns[block] == row) {
    std::fill(gradient + pattern.offsets[row], gradient + pattern.offsets[row + 1], 0.0);
    std::fill(diagonal + pattern.offsets[row], diagonal + pattern.offsets[row + 1], 0.0);
  }
}

int ChunkSums::EndOfTerms(int chunk, int s) const {
  const ProductPlan::Segment& segment = plans_.hessian.segments[s];
  const FramePlans::HessianSource& source = plans_.hessian_sources[segment.source];
  const Linearization& cache = evaluator_.families()[source.family];
  const std::ptrdiff_t limit = evaluator_.jacobian_chunks()->End(chunk, source.family) *
                               (cache.slots[source.column_slot].factor_stride / kQuad);
  const ProductTerm* const terms = plans_.hessian.terms.data() + segment.first_term;
  int end = next_term_[s];
  while (end < segment.count && terms[end].a < limit) {
    ++end;
  }
  return end;
}

bool ChunkSums::HasTerms(int chunk, std::size_t block) const {
  bool has = false;
  for (int s = plans_.hessian.segments_begin[block];
       !has && s < plans_.hessian.segments_begin[block + 1]; ++s) {
    has = EndOfTerms(chunk, s) > next_term_[s];
  }
  return has;
}

// sum += the products of the block, g += Jᵀf of its row if it is a diagonal one. Jacobians lie
// elsewhere in each chunk.
void ChunkSums::AddTerms(int chunk, std::size_t block, double* sum, double* g) {
  const BlockPattern& pattern = plans_.pattern;
  for (int s = plans_.hessian.segments_begin[block]; s < plans_.hessian.segments_begin[block + 1];
       ++s) {
    const int end = EndOfTerms(chunk, s);
    if (end == next_term_[s]) {
      continue;
    }
    const ProductPlan::Segment& segment = plans_.hessian.segments[s];
    const FramePlans::HessianSource& source = plans_.hessian_sources[segment.source];
    const Linearization& cache = evaluator_.families()[source.family];
    const SlotJacobians& J_row = cache.slots[source.row_slot];
    const SlotJacobians& J_column = cache.slots[source.column_slot];
    BlockProducts products;
    // The kernel's C has the rows of b and the columns of a.
    products.a = J_column.data;
    products.b = J_row.data;
    products.terms = plans_.hessian.terms.data() + segment.first_term + next_term_[s];
    products.count = end - next_term_[s];
    products.depth = cache.residual_size;
    products.a_size = pattern.block_size(pattern.columns[block]);
    products.b_size = pattern.block_size(plans_.block_row[block]);
    products.a_stride = J_column.UnpaddedStride();
    products.b_stride = J_row.UnpaddedStride();
    products.symmetric = source.row_slot == source.column_slot;
    kernels_.accumulate_products(products, 1.0, sum);
    if (g != nullptr) {
      VectorProducts gradient;
      gradient.a = products.b;
      gradient.v = cache.residuals.data();
      gradient.terms = products.terms;  // of a product with itself: .b says where f is
      gradient.count = products.count;
      gradient.depth = products.depth;
      gradient.a_size = products.b_size;
      gradient.a_stride = products.b_stride;
      kernels_.accumulate_vectors(gradient, 1.0, g);
    }
    next_term_[s] = end;
  }
}

void ChunkSums::AddToBlock(int chunk, std::size_t block, double* C, double* gradient,
                           double* diagonal) {
  const BlockPattern& pattern = plans_.pattern;
  const int row = plans_.block_row[block];
  const int rows = pattern.block_size(row);
  const int columns = pattern.block_size(pattern.columns[block]);
  const bool is_diagonal = pattern.columns[block] == row;
  BlockScratch scratch, gradient_scratch;
  double* const sum = scratch.Zeroed(rows, columns);
  double* const g = is_diagonal ? gradient_scratch.Zeroed(1, rows) : nullptr;
  AddTerms(chunk, block, sum, g);
  if (is_diagonal) {
    MirrorLowerTriangle(rows, PadToQuad(columns), sum);
  }
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      C[r * columns + c] += sum[r * PadToQuad(columns) + c];
    }
  }
  for (int k = 0; is_diagonal && k < rows; ++k) {
    gradient[pattern.offsets[row] + k] += g[k];
    diagonal[pattern.offsets[row] + k] = C[k * columns + k];
  }
}

}  // namespace inceres::internal
