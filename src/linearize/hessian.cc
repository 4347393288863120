#include "linearize/hessian.h"

#include <algorithm>
#include <functional>
#include <limits>

#include "linearize/single_jacobians.h"
#include "simd/pack_block.h"

namespace inceres::internal {

// H = Σ JᵀJ and η = −Σ Jᵀf of a batch solve (docs/algorithms.md, "Schur complement"): C, P and η
// are summed from the evaluator's Jacobians, which are corrected for losses already. W is never
// formed; undamped and unscaled, one H serves every radius.
//
// FramePlans lists the products of each block of C once for a structure, as offsets into the
// families' Jacobians, so that a sum is a run of one kernel over a list. Each block and each
// landmark has one task, and its sum the order of the plan: the bits do not depend on the number of
// threads.
//
// The gradient is taken in the same pass, and is Jᵀf, not −Jᵀf: gradient_ = −η. The diagonal of H,
// which damping and scaling read, is copied out of C. Of P it is the only copy, and so is the
// gradient of η: of a large problem the landmarks' blocks are most of H.

namespace {

// Blocks, and landmarks, that are worth a task.
constexpr int kBlockGrain = 8;
constexpr int kLandmarkGrain = 64;

// Of a block on the diagonal the lower triangle counts; packed it has both.
template <int kSize>
void PackSymmetric(const double* padded, double* packed) {
  constexpr int kStride = PadToQuad(kSize);
#pragma GCC unroll 6
  for (int r = 0; r < kSize; ++r) {
#pragma GCC unroll 6
    for (int c = 0; c < kSize; ++c) {
      packed[r * kSize + c] = padded[c <= r ? r * kStride + c : c * kStride + r];
    }
  }
}

void PackDiagonal(int size, double* padded, double* packed) {
  if (size == 3) {
    return PackSymmetric<3>(padded, packed);
  }
  if (size == 6) {
    return PackSymmetric<6>(padded, packed);
  }
  MirrorLowerTriangle(size, PadToQuad(size), padded);
  PackBlock(size, size, padded, packed, size);
}

}  // namespace

// Of a landmark of size d P takes d (d − 1) / 2 numbers here and its diagonal in diagonal_, and η
// none, as it is −gradient_: three numbers of a point, where P with padding would be twelve. Where
// Jacobians come in chunks these are cut here, and H is summed as they come.
Hessian::Hessian(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                 const FramePlans& plans)
    : evaluator_(evaluator),
      incidences_(incidences),
      plans_(plans),
      kernels_(BestKernels()),
      kept_(evaluator, plans),
      below_stride_(incidences.largest_size * (incidences.largest_size - 1) / 2) {
  PlaceFrameBlocks();
  const auto size = static_cast<std::int64_t>(incidences.sizes.size()) * below_stride_;
  evaluator.Take(static_cast<std::int64_t>(sizeof(double)) * size, "the blocks of the landmarks");
  below_diagonal_ = ZeroedArray::Unwritten(size);
  gradient_.resize(static_cast<std::size_t>(evaluator.layout().size()));
  diagonal_.resize(gradient_.size());
  if (JacobianChunks* const chunks = evaluator.jacobian_chunks()) {
    chunks->Cut(incidences);
    chunks->ReadBy([this](int chunk) { AccumulateChunk(chunk); });
    chunk_sums_ = std::make_unique<ChunkSums>(evaluator, plans);
    return;
  }
  BuildProducts();
  PlanSmallBlocks();
}

// A block of the pattern without products is zero, such as one of frames that share landmarks only,
// and has no memory. A frame without factors keeps its diagonal block: damping is added to it.
void Hessian::PlaceFrameBlocks() {
  const BlockPattern& pattern = plans_.pattern;
  C_begin_.assign(pattern.columns.size(), -1);
  std::int64_t size = 0;
  for (std::size_t k = 0; k < pattern.columns.size(); ++k) {
    if (plans_.hessian.segments_begin[k + 1] > plans_.hessian.segments_begin[k] ||
        pattern.columns[k] == plans_.block_row[k]) {
      C_begin_[k] = size;
      size += pattern.value_begin[k + 1] - pattern.value_begin[k];
    }
  }
  evaluator_.Take(static_cast<std::int64_t>(sizeof(double)) * size, "the blocks of the frames");
  C_ = ZeroedArray::Unwritten(size);
}

// Jacobians stay where they are, so what the kernels are told of a source is put together once: of
// the blocks of a pose graph most have a single product, which takes no longer than that would.
// Families in single precision have no residuals to multiply with: their part of the gradient comes
// from the strips (Evaluator::strip_gradient), and v is null to say so.
void Hessian::BuildProducts() {
  sources_.reserve(plans_.hessian_sources.size());
  for (const FramePlans::HessianSource& source : plans_.hessian_sources) {
    const Linearization& cache = evaluator_.families()[source.family];
    Source made;
    made.family = source.family;
    made.keeps_singles = cache.keeps_singles();
    made.products = ProductsOf(cache, source.row_slot, source.column_slot);
    made.products.is_near = AreNear(static_cast<std::int64_t>(cache.jacobian_values.size()));
    made.gradient = GradientOf(cache, source.row_slot);
    made.gradient.v = cache.keeps_singles() ? nullptr : made.gradient.v;
    sources_.push_back(made);
  }
}

// Blocks of 3 × 3, of planar poses or of the halves of spatial ones: mostly one product a block,
// and what is around it would take several times as long. So one kernel sums all of a block, and
// the gradient of a diagonal one, from terms that say all. Terms are listed here with everything
// that a product needs, in the order of the plan, segments apart: sums are those of
// accumulate_products segment by segment, and have the same bits. Where a family of another depth
// comes first, all blocks with other depths are summed by the usual way.
void Hessian::PlanSmallBlocks() {
  for (const Source& source : sources_) {
    small_sources_.push_back({source.products.a, source.products.b, source.gradient.v});
  }
  small_blocks_.resize(plans_.block_row.size());
  for (std::size_t block = 0; block < small_blocks_.size(); ++block) {
    if (!IsSmall(block)) {
      continue;
    }
    const int row = plans_.block_row[block];
    SmallBlock* const small = &small_blocks_[block];
    small->C = C_begin_[block];
    small->first_term = static_cast<std::int32_t>(small_terms_.size());
    AddSmallTerms(block);
    small->num_terms = static_cast<std::int32_t>(small_terms_.size()) - small->first_term;
    small->y = plans_.pattern.columns[block] == row ? plans_.pattern.offsets[row] : -1;
  }
  if (small_terms_.empty()) {
    small_blocks_ = {};  // there may be as many as pairs of cameras
  }
}

// Of residuals of 3 or 6, whichever comes first, in double, rows padded, with no product that is
// kept. The depth is decided by the first block that is small, and the kernel is told it once for
// all of them.
bool Hessian::IsSmall(std::size_t block) {
  constexpr int kSize = 3;
  constexpr int kMostTerms = 32;  // of a segment: more are summed in batches
  const BlockPattern& pattern = plans_.pattern;
  if (pattern.block_size(plans_.block_row[block]) != kSize ||
      pattern.block_size(pattern.columns[block]) != kSize ||
      sources_.size() > std::numeric_limits<std::int16_t>::max()) {
    return false;
  }
  const int begin = plans_.hessian.segments_begin[block];
  const int end = plans_.hessian.segments_begin[block + 1];
  int depth = small_depth_;
  for (int s = begin; s < end; ++s) {
    const ProductPlan::Segment& segment = plans_.hessian.segments[s];
    const Source& source = sources_[segment.source];
    depth = depth == 0 ? source.products.depth : depth;
    if ((depth != kSize && depth != 2 * kSize) || source.products.depth != depth ||
        source.products.a_stride != 0 || source.products.b_stride != 0 || source.keeps_singles ||
        segment.count > kMostTerms || kept_.Find(s) != nullptr) {
      return false;
    }
  }
  return begin < end;
}

// A symmetric product has one factor, and its second place says where the residual is
// (ProductTerm); others have no part in the gradient.
void Hessian::AddSmallTerms(std::size_t block) {
  for (int s = plans_.hessian.segments_begin[block]; s < plans_.hessian.segments_begin[block + 1];
       ++s) {
    const ProductPlan::Segment& segment = plans_.hessian.segments[s];
    const BlockProducts& products = sources_[segment.source].products;
    small_depth_ = products.depth;
    for (int n = 0; n < segment.count; ++n) {
      const auto [a, b] = plans_.hessian.terms[segment.first_term + n];
      small_terms_.push_back({a, products.symmetric ? a : b, products.symmetric ? b : 0,
                              static_cast<std::int16_t>(segment.source), n + 1 == segment.count});
    }
  }
}

// Frames and landmarks write to entries of their own, also of gradient_ and diagonal_. Two passes
// over J, by frames in the order of FramePlans and by landmarks in that of LandmarkIncidences.
void Hessian::Accumulate() {
  if (chunk_sums_ != nullptr) {
    return;  // done as they came
  }
  const Executor& executor = evaluator_.executor();
  kept_.Observe();
  executor.For(static_cast<int>(plans_.block_row.size()), kBlockGrain,
               [&](int b, int e) { AccumulateFrameBlocks(b, e); });
  executor.For(incidences_.num_landmarks(), kLandmarkGrain,
               [&](int b, int e) { AccumulateLandmarks(b, e); });
}

// With a diagonal block goes the gradient of its frame: the Jacobians are then still in the cache.
void Hessian::AccumulateFrameBlocks(int begin, int end) {
  const BlockPattern& pattern = plans_.pattern;
  BlockScratch scratch;
  for (int block = SumSmallBlocks(begin, end); block < end;
       block = SumSmallBlocks(block + 1, end)) {
    const auto k = static_cast<std::size_t>(block);
    if (C_begin_[k] < 0) {
      continue;
    }
    const int rows = pattern.block_size(plans_.block_row[k]);
    const int columns = pattern.block_size(pattern.columns[k]);
    // The kernels sum into blocks whose rows are padded to quads; in C rows follow each other
    // without a gap.
    double* sum = scratch.Zeroed(rows, columns);
    // One segment per family and pair of slots, in the order of the plan.
    for (int s = plans_.hessian.segments_begin[k]; s < plans_.hessian.segments_begin[k + 1]; ++s) {
      AddSegment(s, rows, columns, sum);
    }
    const bool is_diagonal = pattern.columns[k] == plans_.block_row[k];
    // Of products that are symmetric the kernels may leave out what is above the diagonal.
    if (is_diagonal) {
      PackDiagonal(rows, sum, C_.data() + C_begin_[k]);
      AccumulateGradient(plans_.block_row[k], &scratch);
    } else {
      PackBlock(rows, columns, sum, C_.data() + C_begin_[k], columns);
    }
  }
}

// Blocks of C go on from chunk to chunk, landmarks have all of their factors in one.
void Hessian::AccumulateChunk(int chunk) {
  chunk_sums_->Add(chunk, C_begin_, C_.data(), gradient_.data(), diagonal_.data());
  if (chunk < incidences_.num_chunks()) {
    const int first = incidences_.chunk_begin[chunk];
    evaluator_.executor().For(
        incidences_.chunk_begin[chunk + 1] - first, kLandmarkGrain,
        [&](int begin, int end) { AccumulateLandmarks(first + begin, first + end); });
  }
}

// Those from `begin` on; returns the first block that is not one of them, or `end`. A run of
// neighbors is one call: what is around a call would take longer than a block of one product.
int Hessian::SumSmallBlocks(int begin, int end) {
  if (small_terms_.empty() || begin == end || small_blocks_[begin].num_terms == 0) {
    return begin;
  }
  const SmallBlock* const first = small_blocks_.data() + begin;
  const auto last = std::find_if(first, first + (end - begin),
                                 [](const SmallBlock& block) { return block.num_terms == 0; });
  const int count = static_cast<int>(last - first);
  kernels_.sum_products_of_three({small_sources_.data(), small_terms_.data(), small_depth_}, first,
                                 count, C_.data(), gradient_.data(), diagonal_.data());
  return begin + count;
}

// A kept product is summed apart, whether it is formed now or was before: the bits are the same.
// Products of a family whose Jacobians have not changed since are not formed again, which is what
// keeping is for.
void Hessian::AddSegment(int s, int rows, int columns, double* sum) {
  const ProductPlan::Segment& segment = plans_.hessian.segments[s];
  const Source& source = sources_[segment.source];
  const int size = rows * PadToQuad(columns);
  double* const kept = kept_.Find(s);
  if (kept == nullptr || kept_.IsStale(source.family)) {
    BlockProducts products = source.products;
    products.terms = plans_.hessian.terms.data() + segment.first_term;
    products.count = segment.count;
    products.a_size = columns;
    products.b_size = rows;
    if (kept != nullptr) {
      std::fill(kept, kept + size, 0.0);
    }
    double* const out = kept != nullptr ? kept : sum;
    if (source.keeps_singles) {
      AddWidened(segment.source, products, out);
    } else {
      kernels_.accumulate_products(products, 1.0, out);
    }
  }
  if (kept != nullptr) {
    std::transform(kept, kept + size, sum, sum, std::plus<>());
  }
}

// Products of Jacobians in single precision, whose terms count from those.
void Hessian::AddWidened(int source, const BlockProducts& products, double* out) const {
  const FramePlans::HessianSource& of = plans_.hessian_sources[source];
  const Linearization& cache = evaluator_.families()[of.family];
  const SlotJacobians& J_column = cache.slots[of.column_slot];
  const SlotJacobians& J_row = cache.slots[of.row_slot];
  AccumulateWidened(kernels_, products, J_column.single,
                    products.symmetric ? nullptr : J_row.single, out);
}

// g_i = Σ J_iᵀf in the order of the plan of the diagonal block, whose terms name the residuals: no
// list of its own. Strips' part of it comes first. The diagonal is read from C, as the diagonal
// block has just been written by the same task.
void Hessian::AccumulateGradient(int frame, BlockScratch* scratch) {
  const BlockPattern& pattern = plans_.pattern;
  const auto i = static_cast<std::size_t>(frame);
  const int size = pattern.block_size(frame);
  const int block = pattern.row_begin[i + 1] - 1;  // on the diagonal: the last one of its row
  double* sum = scratch->Zeroed(1, size);
  if (const double* const g = evaluator_.strip_gradient(); g != nullptr) {
    std::copy_n(g + static_cast<std::ptrdiff_t>(evaluator_.layout().quad_offset[i]) * kQuad, size,
                sum);
  }
  for (int s = plans_.hessian.segments_begin[block]; s < plans_.hessian.segments_begin[block + 1];
       ++s) {
    const ProductPlan::Segment& segment = plans_.hessian.segments[s];
    VectorProducts products = sources_[segment.source].gradient;
    if (products.v == nullptr) {
      continue;
    }
    products.terms = plans_.hessian.terms.data() + segment.first_term;
    products.count = segment.count;
    products.a_size = size;
    kernels_.accumulate_vectors(products, 1.0, sum);
  }
  std::copy(sum, sum + size, gradient_.data() + pattern.offsets[i]);
  const double* C_ii = FrameBlock(block);
  for (int k = 0; k < size; ++k) {
    diagonal_[pattern.offsets[i] + k] = C_ii[k * size + k];
  }
}

// P and η_l of one landmark, from its factors alone, family after family. The kernels sum −Jᵀf,
// hence the two signs: gradient_ is Jᵀf of landmarks as of frames.
void Hessian::AccumulateLandmarks(int begin, int end) {
  const Layout& layout = evaluator_.layout();
  for (int l = begin; l < end; ++l) {
    const auto i = static_cast<std::size_t>(l);
    const int size = incidences_.sizes[i];
    alignas(64) double P[kQuad * kQuad];
    alignas(64) double eta[kQuad] = {};
    std::fill_n(P, size * kQuad, 0.0);
    for (int k = incidences_.factors_begin[i]; k < incidences_.factors_begin[i + 1]; ++k) {
      kernels_.landmark_gram(size, incidences_.FactorsAt(k), P, eta);
    }
    if (const double* const g = evaluator_.strip_gradient(); g != nullptr) {
      const double* const of_landmark =
          g + static_cast<std::ptrdiff_t>(layout.quad_offset[layout.num_frames + l]) * kQuad;
      std::transform(eta, eta + size, of_landmark, eta, std::minus<>());  // η = −Jᵀf
    }
    const int offset = OffsetOf(l);
    double* below = below_diagonal_.data() + l * below_stride_;
    for (int r = 0; r < size; ++r) {
      gradient_[offset + r] = -eta[r];
      diagonal_[offset + r] = P[r * kQuad + r];
      for (int c = 0; c < r; ++c) {
        *below++ = P[r * kQuad + c];
      }
    }
  }
}

void Hessian::GetP(int l, double* P) const {
  const double* below = below_diagonal_.data() + l * below_stride_;
  const double* const diagonal = diagonal_.data() + OffsetOf(l);
  const int size = incidences_.sizes[l];
  for (int r = 0; r < size; ++r) {
    for (int c = 0; c < r; ++c) {
      P[r * kQuad + c] = *below++;
    }
    P[r * kQuad + r] = diagonal[r];
  }
}

void Hessian::GetLandmarkEta(int l, double* eta) const {
  const double* const gradient = gradient_.data() + OffsetOf(l);
  std::transform(gradient, gradient + incidences_.sizes[l], eta, std::negate<>());
}

}  // namespace inceres::internal
