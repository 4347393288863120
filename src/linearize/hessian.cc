#include "linearize/hessian.h"

#include <algorithm>
#include <functional>

#include "linearize/widened.h"

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
// which damping and scaling read, is copied out of C and P.

namespace {

// Blocks, and landmarks, that are worth a task.
constexpr int kBlockGrain = 8;
constexpr int kLandmarkGrain = 64;

// All P have room for the largest one, so that P of a landmark is found by multiplication.
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
  PackBlock(size, size, padded, packed);
}

std::ptrdiff_t LargestSize(const LandmarkIncidences& incidences) {
  return incidences.sizes.empty()
             ? 0
             : *std::max_element(incidences.sizes.begin(), incidences.sizes.end());
}

}  // namespace

Hessian::Hessian(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                 const FramePlans& plans)
    : evaluator_(evaluator),
      incidences_(incidences),
      plans_(plans),
      kernels_(BestKernels()),
      kept_(evaluator, plans),
      landmark_stride_(LargestSize(incidences) * kQuad) {
  const auto num_landmarks = static_cast<std::size_t>(incidences.num_landmarks());
  PlaceFrameBlocks();
  P_ = ZeroedArray::Unwritten(num_landmarks * landmark_stride_);
  landmark_eta_ = ZeroedArray::Unwritten(num_landmarks * kQuad);
  gradient_.resize(static_cast<std::size_t>(evaluator.layout().size()));
  diagonal_.resize(gradient_.size());
  BuildProducts();
  BuildGradientTerms();
  for (const Linearization& cache : evaluator.families()) {
    residuals_.push_back(cache.keeps_singles() ? nullptr : cache.residuals.data());
  }
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
  C_ = ZeroedArray::Unwritten(size);
}

// Jacobians stay where they are, so what the kernels are told of a source is put together once: of
// the blocks of a pose graph most have a single product, which takes no longer than that would.
void Hessian::BuildProducts() {
  for (const FramePlans::HessianSource& source : plans_.hessian_sources) {
    const Linearization& cache = evaluator_.families()[source.family];
    Source made;
    made.family = source.family;
    made.keeps_singles = cache.keeps_singles();
    // The kernel's C has the rows of b and the columns of a.
    made.products.a = cache.slots[source.column_slot].data;
    made.products.b = cache.slots[source.row_slot].data;
    made.products.depth = cache.residual_size;
    // The same slot for row and column: every term is a Jacobian with itself.
    made.products.symmetric = source.row_slot == source.column_slot;
    made.products.is_near = AreNear(static_cast<std::int64_t>(cache.jacobian_values.size()));
    made.gradient.a = cache.slots[source.row_slot].data;
    made.gradient.depth = cache.residual_size;
    sources_.push_back(made);
  }
}

void Hessian::BuildGradientTerms() {
  // The diagonal blocks' terms are exactly the (factor, slot) pairs of each frame.
  // Each comes once because no factor repeats a variable (FactorGraph::Validate).
  const BlockPattern& pattern = plans_.pattern;
  gradient_segments_begin_.push_back(0);
  for (int frame = 0; frame < pattern.num_blocks(); ++frame) {
    const auto block = static_cast<std::size_t>(pattern.row_begin[frame + 1]) - 1;
    for (int k = plans_.hessian.segments_begin[block]; k < plans_.hessian.segments_begin[block + 1];
         ++k) {
      const ProductPlan::Segment& segment = plans_.hessian.segments[k];
      const FramePlans::HessianSource& source = plans_.hessian_sources[segment.source];
      const Linearization& cache = evaluator_.families()[source.family];
      // Quads of a factor's block of Jacobian: an offset over this is the factor's number, and that
      // times its residual's size is where its residual is.
      const auto quads =
          static_cast<std::int32_t>(cache.slots[source.row_slot].factor_stride / kQuad);
      gradient_segments_.push_back(
          {segment.source, static_cast<int>(gradient_terms_.size()), segment.count});
      for (int n = 0; n < segment.count; ++n) {
        const std::int32_t offset = plans_.hessian.terms[segment.first_term + n].b;
        gradient_terms_.push_back({offset, offset / quads * cache.residual_size});
      }
    }
    gradient_segments_begin_.push_back(static_cast<int>(gradient_segments_.size()));
  }
}

// Frames and landmarks write to entries of their own, also of gradient_ and diagonal_.
void Hessian::Accumulate() {
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
  for (int block = begin; block < end; ++block) {
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
      PackBlock(rows, columns, sum, C_.data() + C_begin_[k]);
    }
  }
}

// A kept product is summed apart, whether it is formed now or was before: the bits are the same.
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
  for (int k = 0; k < size && kept != nullptr; ++k) {
    sum[k] += kept[k];
  }
}

// Products of Jacobians in single precision, whose terms count from those.
void Hessian::AddWidened(int source, const BlockProducts& products, double* out) const {
  const FramePlans::HessianSource& of = plans_.hessian_sources[source];
  const Linearization& cache = evaluator_.families()[of.family];
  const SlotJacobians& J_column = cache.slots[of.column_slot];
  const SlotJacobians& J_row = cache.slots[of.row_slot];
  AccumulateWidened(kernels_, products, J_column.single, J_column.factor_stride / kQuad,
                    products.symmetric ? nullptr : J_row.single, J_row.factor_stride / kQuad, out);
}

void Hessian::AccumulateGradient(int frame, BlockScratch* scratch) {
  const BlockPattern& pattern = plans_.pattern;
  const auto i = static_cast<std::size_t>(frame);
  const int size = pattern.block_size(frame);
  double* sum = scratch->Zeroed(1, size);
  if (const double* const g = evaluator_.strip_gradient(); g != nullptr) {
    std::copy_n(g + static_cast<std::ptrdiff_t>(evaluator_.layout().quad_offset[i]) * kQuad, size,
                sum);
  }
  AddTransposed(residuals_, frame, sum);
  std::copy(sum, sum + size, gradient_.data() + pattern.offsets[i]);
  // The diagonal block is the last one of its row.
  const double* C_ii = FrameBlock(pattern.row_begin[i + 1] - 1);
  for (int k = 0; k < size; ++k) {
    diagonal_[pattern.offsets[i] + k] = C_ii[k * size + k];
  }
}

// Also for right-hand sides other than f; a family whose r is zero is left out by a null pointer.
void Hessian::AddTransposed(const std::vector<const double*>& rows, int frame, double* sum) const {
  for (int s = gradient_segments_begin_[frame]; s < gradient_segments_begin_[frame + 1]; ++s) {
    const GradientSegment& segment = gradient_segments_[s];
    const Source& source = sources_[segment.source];
    if (rows[source.family] == nullptr) {
      continue;
    }
    VectorProducts products = source.gradient;
    products.v = rows[source.family];
    products.terms = gradient_terms_.data() + segment.first_term;
    products.count = segment.count;
    products.a_size = plans_.pattern.block_size(frame);
    kernels_.accumulate_vectors(products, 1.0, sum);
  }
}

// P and η_l of one landmark, from its factors alone, family after family. Rows of P are a quad
// apart whatever its size; entries beyond it stay zero, as the padding of J is.
void Hessian::AccumulateLandmarks(int begin, int end) {
  const Layout& layout = evaluator_.layout();
  WidenedLandmarkFactors widened;
  for (int l = begin; l < end; ++l) {
    const auto i = static_cast<std::size_t>(l);
    double* P = P_.data() + l * landmark_stride_;
    double* eta = landmark_eta_.data() + static_cast<std::ptrdiff_t>(l) * kQuad;
    std::fill(P, P + landmark_stride_, 0.0);
    std::fill(eta, eta + kQuad, 0.0);
    const int size = incidences_.sizes[i];
    for (int k = incidences_.factors_begin[i]; k < incidences_.factors_begin[i + 1]; ++k) {
      widened.ForEach(incidences_.factors[k], [&](const LandmarkFactors& factors) {
        kernels_.landmark_gram(size, factors, P, eta);
      });
    }
    if (const double* const g = evaluator_.strip_gradient(); g != nullptr) {
      const double* const of_landmark =
          g + static_cast<std::ptrdiff_t>(layout.quad_offset[layout.num_frames + l]) * kQuad;
      std::transform(eta, eta + size, of_landmark, eta, std::minus<>());  // η = −Jᵀf
    }
    // Landmarks come behind the frames in packed vectors.
    const int offset = layout.packed_offset[layout.num_frames + l];
    for (int c = 0; c < size; ++c) {
      gradient_[offset + c] = -eta[c];
      diagonal_[offset + c] = P[c * kQuad + c];
    }
  }
}

}  // namespace inceres::internal
