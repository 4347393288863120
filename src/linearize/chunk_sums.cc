#include "linearize/chunk_sums.h"

#include <algorithm>

#include "linearize/block_scratch.h"

namespace inceres::internal {

// The frames' half of H from Jacobians in chunks (docs/algorithms.md, "Linearization"). The plan of
// products is that of Jacobians that are kept; of each of its segments the chunk has a run of
// terms, behind those of the chunk before.
//
// A chunk has of each family the records from Begin to End, and terms of a segment ascend by
// record: so a number for each segment, of the next term, is all that is remembered between chunks.
// Whether a term has come is seen from the place that it names, for places are counted in quads
// from record 0 whatever chunk is in memory.
//
// What a chunk adds to a block is summed by itself, from zeros and with padded rows, as the kernels
// want it, and then added to C, whose rows follow each other without a gap. So a block's sum is one
// of chunks in their order, and of terms in the order of the plan within each: it differs by
// rounding from that of Jacobians that are kept, and not with the number of threads. Each task has
// blocks of its own, and with them their segments' numbers, and of a diagonal block the frame's
// entries of the gradient and the diagonal.

namespace {

constexpr int kGrain = 64;  // blocks: most have no term in a chunk

}  // namespace

ChunkSums::ChunkSums(const Evaluator& evaluator, const FramePlans& plans)
    : evaluator_(evaluator),
      plans_(plans),
      kernels_(BestKernels()),
      next_term_(plans.hessian.segments.size()) {
}

// Cost, besides the products: a look at the next term of each segment, chunk by chunk. Blocks
// without memory in C have no segments, as frames that share landmarks only.
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

// A block that no chunk adds to is zero all the same, and so is the gradient of a frame without
// factors, whose diagonal block is there for the damping.
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

// Whether the segment has this term, in the chunk or one before.
bool ChunkSums::HasCome(int chunk, int s, int term) const {
  const ProductPlan::Segment& segment = plans_.hessian.segments[s];
  const FramePlans::HessianSource& source = plans_.hessian_sources[segment.source];
  const Linearization& cache = evaluator_.families()[source.family];
  const std::ptrdiff_t quads = cache.slots[source.column_slot].factor_stride / kQuad;
  return term < segment.count &&
         plans_.hessian.terms[segment.first_term + term].a <
             evaluator_.jacobian_chunks()->End(chunk, source.family) * quads;
}

// Looked at before AddToBlock clears its room for a sum: of most blocks a chunk has nothing.
bool ChunkSums::HasTerms(int chunk, std::size_t block) const {
  bool has = false;
  for (int s = plans_.hessian.segments_begin[block];
       !has && s < plans_.hessian.segments_begin[block + 1]; ++s) {
    has = HasCome(chunk, s, next_term_[s]);
  }
  return has;
}

// sum += the products of the block, g += Jᵀf of its row if it is a diagonal one. Jacobians lie
// elsewhere in each chunk. ProductsOf is therefore asked anew, and not once as where Jacobians are
// kept. The run of terms is closed before the kernels see it, so they take it in one call.
void ChunkSums::AddTerms(int chunk, std::size_t block, double* sum, double* g) {
  const BlockPattern& pattern = plans_.pattern;
  for (int s = plans_.hessian.segments_begin[block]; s < plans_.hessian.segments_begin[block + 1];
       ++s) {
    const int first = next_term_[s];
    while (HasCome(chunk, s, next_term_[s])) {
      ++next_term_[s];
    }
    if (next_term_[s] == first) {
      continue;
    }
    const ProductPlan::Segment& segment = plans_.hessian.segments[s];
    const FramePlans::HessianSource& source = plans_.hessian_sources[segment.source];
    const Linearization& cache = evaluator_.families()[source.family];
    BlockProducts products = ProductsOf(cache, source.row_slot, source.column_slot);
    products.terms = plans_.hessian.terms.data() + segment.first_term + first;
    products.count = next_term_[s] - first;
    products.a_size = pattern.block_size(pattern.columns[block]);
    products.b_size = pattern.block_size(plans_.block_row[block]);
    kernels_.accumulate_products(products, 1.0, sum);
    if (g != nullptr) {
      VectorProducts gradient = GradientOf(cache, source.row_slot);
      gradient.terms = products.terms;  // of a product with itself: .b says where f is
      gradient.count = products.count;
      gradient.a_size = products.b_size;
      kernels_.accumulate_vectors(gradient, 1.0, g);
    }
  }
}

// The kernels fill the lower triangle of a symmetric block; it is mirrored before it is added, so
// that C has whole squares. The diagonal is copied after each chunk that adds something: that of
// the last one stays.
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
