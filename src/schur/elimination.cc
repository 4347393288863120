#include "schur/elimination.h"

#include <algorithm>

#include "base/address.h"
#include "base/counting_sort.h"
#include "base/lowest_index.h"
#include "linear/small_cholesky.h"

namespace inceres::internal {

// The batch Schur complement, gathered (docs/algorithms.md, "Schur complement"; Triggs et al. 1999,
// section 6.1):
//
//     L Lᵀ = P + Λ_l,   U_inv = L⁻¹,   Y = W U_invᵀ,   z = U_inv l,
//     S = C − Y Yᵀ,   b = c − Y z,   δ_l = U_invᵀ (z − Yᵀ δ_c).
//
// Chunk by chunk: first the landmarks of the chunk, in parallel, each writing its own U_inv, z and
// blocks of Y; then the blocks of S that share a landmark of the chunk, in parallel, each summed by
// one task in the order of its plan. So no task adds to what another one writes, and the bits are
// the same for any number of threads. The first chunk begins a block with C, the later ones add to
// it.
//
// Kept after Eliminate: U_inv and z of all landmarks, unless they may be forgotten and are many,
// and Y where there is one chunk. Where there are more, Y was overwritten, and the way back takes
// Wᵀδ_c from the Jacobians, as it does where blocks of Y have their last column apart. Where no
// block of S is formed and there are several chunks, nothing is worth a Y at all, and b comes from
// the Jacobians too.

namespace {

constexpr int kBlockGrain = 4;
constexpr int kLandmarkGrain = 64;
// Their U_inv and z take 8 MiB.
constexpr int kFewLandmarks = 1 << 16;

// out = base + the rows of `block`, padded to quads; none overlaps another. kColumns 0: their
// number is known at run time.
template <int kColumns>
void SumRows(int rows, int columns, const double* __restrict base, const double* __restrict block,
             double* __restrict out) {
  const int width = kColumns > 0 ? kColumns : columns;
  for (int r = 0; r < rows; ++r, block += PadToQuad(width), base += width, out += width) {
    for (int c = 0; c < width; ++c) {
      out[c] = base[c] + block[c];
    }
  }
}

void AddRows(int rows, int columns, const double* __restrict block, double* __restrict out) {
  for (int r = 0; r < rows; ++r, block += PadToQuad(columns), out += columns) {
    for (int c = 0; c < columns; ++c) {
      out[c] += block[c];
    }
  }
}

}  // namespace

Elimination::Elimination(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                         const FramePlans& plans, const Hessian& hessian,
                         const EliminationMemory& memory)
    : evaluator_(evaluator),
      incidences_(incidences),
      plans_(plans),
      hessian_(hessian),
      kernels_(BestKernels()),
      stride_(std::ptrdiff_t{incidences.largest_size} * kQuad),
      coupled_(evaluator, incidences),
      // Whether Y is written: for blocks of S, or for b and the way back.
      keeps_all_(plans.forms_schur || incidences.num_chunks() == 1 ||
                 evaluator.jacobian_chunks() != nullptr) {
  TakeMemory(memory);
  b_.resize(plans.pattern.size());
  const Layout& layout = evaluator.layout();
  padded_frame_step_.resize(layout.quad_offset[layout.num_frames] * kQuad);
  CollectChunkBlocks();
}

// Memory is asked for before it is taken, so that a problem that is too large is refused by name.
void Elimination::TakeMemory(const EliminationMemory& memory) {
  const int num_chunks = incidences_.num_chunks();
  keeps_landmarks_ = !memory.may_forget_landmarks || !keeps_all_ || num_chunks == 1 ||
                     incidences_.num_landmarks() <= kFewLandmarks;
  int num_kept = keeps_landmarks_ ? incidences_.num_landmarks() : 0;
  for (int chunk = 0; chunk < num_chunks; ++chunk) {
    num_kept =
        std::max(num_kept, incidences_.chunk_begin[chunk + 1] - incidences_.chunk_begin[chunk]);
  }
  constexpr std::int64_t kDouble = sizeof(double);
  evaluator_.Take(kDouble * num_kept * (stride_ + kQuad), "the factors of the landmarks' blocks");
  evaluator_.Take(kDouble * kQuad * incidences_.y_quads, "Y of the elimination");
  if (!memory.may_forget_landmarks) {  // else there are none
    evaluator_.Take(coupled_.BytesOfParts(), "products with Jacobians");
  }
  U_inv_ = ZeroedArray(static_cast<std::size_t>(num_kept) * stride_);
  z_ = ZeroedArray(static_cast<std::size_t>(num_kept) * kQuad);
  Y_ = ZeroedArray::Unwritten(incidences_.y_quads * kQuad);
  // S has the values in the pattern of the frame system, also of blocks that no landmark reaches.
  if (memory.S == nullptr) {
    evaluator_.Take(kDouble * plans_.pattern.value_begin.back(),
                    "the values of the reduced system");
    S_memory_ = ZeroedArray::Unwritten(plans_.pattern.value_begin.back());
  }
  S_ = memory.S != nullptr ? memory.S : S_memory_.data();
}

void Elimination::CollectChunkBlocks() {
  const auto num_blocks = static_cast<int>(plans_.block_row.size());
  const auto for_each_block = [&](const auto& add) {
    for (int block = 0; block < num_blocks; ++block) {
      // All blocks, whether or not the first chunk has something for them: it copies C.
      add(0, ChunkBlock{block, plans_.schur.segments_begin[block]});
      int last = 0;
      for (int s = plans_.schur.segments_begin[block]; s < plans_.schur.segments_begin[block + 1];
           ++s) {
        const int chunk = plans_.schur_sources[plans_.schur.segments[s].source].chunk;
        // Segments of a block ascend by chunk: each chunk is noted with the first of its segments.
        if (chunk != last) {
          add(chunk, ChunkBlock{block, s});
          last = chunk;
        }
      }
    }
  };
  CountingSort(incidences_.num_chunks(), for_each_block, &chunk_blocks_begin_, &chunk_blocks_);
}

// Packed vectors of the landmarks alone begin where the frames end.
int Elimination::DampingOffset(int landmark) const {
  const Layout& layout = evaluator_.layout();
  return layout.packed_offset[layout.num_frames + landmark] - layout.frame_size();
}

// The block alone: whether it has a factor is known before any of its Y is computed.
bool Elimination::Factorize(int landmark, double* U_inv) const {
  double P[kQuad * kQuad];
  hessian_.GetP(landmark, P);
  return InvertCholeskyFactor(incidences_.sizes[landmark], P,
                              landmark_damping_ + DampingOffset(landmark), U_inv);
}

// z = U_inv l, and the landmark's blocks of Y family by family: where two factors share a frame,
// the second adds to the block that the first has begun.
void Elimination::EliminateLandmark(int landmark) {
  const auto l = static_cast<std::size_t>(landmark);
  const int size = incidences_.sizes[l];
  const double* const U_inv = UInv(landmark);
  double eta[kQuad];
  hessian_.GetLandmarkEta(landmark, eta);
  double* z = z_.data() + Kept(landmark) * kQuad;
  std::fill_n(z, kQuad, 0.0);
  MultiplyLower(size, U_inv, eta, z);
  // Y_li = Σ J_cᵀ (J_l U_invᵀ), straight from the Jacobians: W is never stored.
  for (int k = incidences_.factors_begin[l]; keeps_all_ && k < incidences_.factors_begin[l + 1];
       ++k) {
    kernels_.eliminate(size, incidences_.FactorsAt(k), U_inv, Y_.data());
  }
}

Status Elimination::Eliminate(const double* landmark_damping) {
  const Executor& executor = evaluator_.executor();
  const int num_landmarks = incidences_.num_landmarks();
  landmark_damping_ = landmark_damping;
  for (int chunk = 0; chunk < incidences_.num_chunks(); ++chunk) {
    first_kept_ = keeps_landmarks_ ? 0 : incidences_.chunk_begin[chunk];
    Status brought = BringJacobians(evaluator_, chunk);
    if (!brought.ok()) {
      return brought;
    }
    // Of several landmarks that fail the first is named, whichever task met it.
    LowestIndex singular(num_landmarks);
    const int first = incidences_.chunk_begin[chunk];
    executor.For(incidences_.chunk_begin[chunk + 1] - first, kLandmarkGrain,
                 [&](int begin, int end) {
                   // All factors first: one does not wait for another's roots and divisions, as its
                   // own blocks of Y do.
                   for (int l = first + begin; l < first + end; ++l) {
                     if (!Factorize(l, U_inv_.data() + Kept(l) * stride_)) {
                       singular.Note(l);
                       return;
                     }
                   }
                   for (int l = first + begin; l < first + end; ++l) {
                     EliminateLandmark(l);
                   }
                 });
    if (singular.get() < num_landmarks) {
      const Layout& layout = evaluator_.layout();
      const VariableId id = layout.variables[layout.num_frames + singular.get()];
      return Status::Error(StatusCode::kSingular,
                           "the block of landmark variable " + std::to_string(id) +
                               " is not positive definite: its factors do not determine it");
    }
    const int first_block = chunk_blocks_begin_[chunk];
    executor.For(
        chunk_blocks_begin_[chunk + 1] - first_block, kBlockGrain,
        [&](int begin, int end) { FormBlocks(chunk, first_block + begin, first_block + end); });
  }
  if (!keeps_all_) {
    // Y was not written, so what FormRightHandSide has left in b is of no use.
    TakeRightHandSideFromJacobians();
  }
  return Status::Ok();
}

// The diagonal block comes last in its row: what b takes is then still in the cache.
void Elimination::FormBlocks(int chunk, int begin, int end) {
  BlockScratch scratch;
  for (int k = begin; k < end; ++k) {
    const ChunkBlock& place = chunk_blocks_[k];
    FormBlock(chunk, place, &scratch);
    const int row = plans_.block_row[place.block];
    if (plans_.pattern.columns[place.block] == row) {
      FormRightHandSide(chunk, place, &scratch);
    }
  }
}

// Whether the block has this segment, and the landmarks of it are in the chunk.
bool Elimination::IsOfChunk(int chunk, std::size_t block, int segment) const {
  return segment < plans_.schur.segments_begin[block + 1] &&
         plans_.schur_sources[plans_.schur.segments[segment].source].chunk == chunk;
}

// A block of S = C − W P⁻¹ Wᵀ: S_ij = C_ij − Σ_l Y_li Y_ljᵀ over the landmarks of this chunk that
// both frames share.
void Elimination::FormBlock(int chunk, const ChunkBlock& place, BlockScratch* scratch) {
  const BlockPattern& pattern = plans_.pattern;
  const auto k = static_cast<std::size_t>(place.block);
  const int rows = pattern.block_size(plans_.block_row[k]);
  const int columns = pattern.block_size(pattern.columns[k]);
  double* out = S_ + pattern.value_begin[k];
  // Null: no factor touches both frames, so the pair is there for its landmarks only.
  const double* const C_ij = chunk == 0 ? hessian_.FrameBlock(place.block) : nullptr;
  const bool adds = plans_.forms_schur && IsOfChunk(chunk, k, place.first_segment);
  if (!adds && C_ij != nullptr) {
    std::copy(C_ij, C_ij + rows * columns, out);
  } else if (chunk == 0 && C_ij == nullptr) {
    std::fill(out, out + rows * columns, 0.0);
  }
  if (!adds) {
    return;  // the first chunk has all blocks
  }
  // Summed apart, in rows padded for the kernel, and added to the packed block at the end.
  double* sum = scratch->Zeroed(rows, columns);
  const bool is_diagonal = pattern.columns[k] == plans_.block_row[k];
  // A segment for each landmark size: the kernel takes products of one depth.
  for (int s = place.first_segment; IsOfChunk(chunk, k, s); ++s) {
    const ProductPlan::Segment& segment = plans_.schur.segments[s];
    BlockProducts products;
    products.a = Y_.data();
    products.b = Y_.data();
    products.terms = plans_.schur.terms.data() + segment.first_term;
    products.count = segment.count;
    products.depth = plans_.schur_sources[segment.source].landmark_size;
    products.a_size = columns;
    products.b_size = rows;
    products.tail = incidences_.tail;
    products.symmetric = is_diagonal;
    products.is_near = AreNear(static_cast<std::int64_t>(Y_.size()));
    kernels_.accumulate_products(products, -1.0, sum);
  }
  // The kernel fills the lower triangle of a symmetric block; the whole square is stored.
  if (is_diagonal) {
    MirrorLowerTriangle(rows, PadToQuad(columns), sum);
  }
  if (C_ij == nullptr) {
    AddRows(rows, columns, sum, out);
  } else if (columns == 6) {
    SumRows<6>(rows, columns, C_ij, sum, out);
  } else {
    SumRows<0>(rows, columns, C_ij, sum, out);
  }
}

// b_i = c_i − Σ_l Y_li z_l over the landmarks of this chunk, those of the diagonal block.
void Elimination::FormRightHandSide(int chunk, const ChunkBlock& place, BlockScratch* scratch) {
  const BlockPattern& pattern = plans_.pattern;
  const int row = plans_.block_row[place.block];
  const int size = pattern.block_size(row);
  double* sum = scratch->Zeroed(1, size);
  for (int s = place.first_segment; IsOfChunk(chunk, place.block, s); ++s) {
    const ProductPlan::Segment& segment = plans_.schur.segments[s];
    // In memory a block of Y has the landmark's rows, so its transpose times z_l is what the kernel
    // takes.
    VectorProducts products;
    products.a = Y_.data();
    products.v = AddressBefore(Kept(0) * -kQuad, z_.data());
    products.terms = plans_.schur.terms.data() + segment.first_term;
    products.count = segment.count;
    products.depth = plans_.schur_sources[segment.source].landmark_size;
    products.a_size = size;
    products.tail = incidences_.tail;
    kernels_.accumulate_vectors(products, -1.0, sum);
  }
  for (int k = 0; k < size; ++k) {
    const int at = pattern.offsets[row] + k;
    // c = −g of the frames, where b begins.
    b_[at] = sum[k] + (chunk == 0 ? -hessian_.gradient()[at] : b_[at]);
  }
}

// Where the products have no residuals, the gradient brings them.
void Elimination::TakeRightHandSideFromJacobians() {
  // The vector serves as a workspace here; BackSubstitute fills it anew.
  std::fill(padded_frame_step_.begin(), padded_frame_step_.end(), 0.0);
  coupled_.AddRightHandSide(z_.data(), U_inv_.data(), padded_frame_step_.data());
  const Layout& layout = evaluator_.layout();
  for (int i = 0; i < layout.num_frames; ++i) {
    const double* const sum =
        padded_frame_step_.data() + static_cast<std::ptrdiff_t>(layout.quad_offset[i]) * kQuad;
    for (int k = layout.packed_offset[i], r = 0; k < layout.packed_offset[i + 1]; ++k, ++r) {
      b_[k] = coupled_.takes_residuals() ? sum[r] : sum[r] - hessian_.gradient()[k];
    }
  }
}

// δ_l = U_invᵀ (z − Yᵀ δ_c), landmark by landmark, each independent of the others.
void Elimination::BackSubstitute(int first, int last, const double* frame_step,
                                 double* landmark_step) {
  if (first == 0) {
    evaluator_.layout().Pad(frame_step, 0, evaluator_.layout().num_frames,
                            padded_frame_step_.data());
  }
  evaluator_.executor().For(last - first, kLandmarkGrain, [&](int begin, int end) {
    for (int landmark = first + begin; landmark < first + end; ++landmark) {
      BackSubstituteLandmark(landmark, landmark_step);
    }
  });
}

void Elimination::BackSubstituteLandmark(int landmark, double* landmark_step) const {
  const auto l = static_cast<std::size_t>(landmark);
  const int size = incidences_.sizes[l];
  double own_U_inv[kQuad * kQuad];
  double y[kQuad] = {};
  const double* U_inv = own_U_inv;
  if (keeps_landmarks_) {
    U_inv = UInv(landmark);
    std::copy_n(z_.data() + Kept(landmark) * kQuad, kQuad, y);
  } else {
    // It had a factor before, and has the same one now.
    Factorize(landmark, own_U_inv);
    double eta[kQuad];
    hessian_.GetLandmarkEta(landmark, eta);
    MultiplyLower(size, U_inv, eta, y);
  }
  // Y of all landmarks is still there, in the layout that the kernel reads.
  if (incidences_.num_chunks() == 1 && !incidences_.tail) {
    kernels_.back_substitute(size, incidences_.incidences.data() + incidences_.begin[l],
                             incidences_.begin[l + 1] - incidences_.begin[l], Y_.data(),
                             padded_frame_step_.data(), y);
  } else {
    double w[kQuad] = {};
    double U_inv_w[kQuad] = {};
    for (int k = incidences_.factors_begin[l]; k < incidences_.factors_begin[l + 1]; ++k) {
      kernels_.multiply_coupling(incidences_.FactorsAt(k), padded_frame_step_.data(), w);
    }
    // Yᵀδ_c = U_inv Wᵀδ_c, with Wᵀδ_c from the Jacobians.
    MultiplyLower(size, U_inv, w, U_inv_w);
    for (int k = 0; k < size; ++k) {
      y[k] -= U_inv_w[k];
    }
  }
  MultiplyLowerTransposed(size, U_inv, y, landmark_step + DampingOffset(landmark));
}

std::int64_t Elimination::Bytes() const {
  return static_cast<std::int64_t>(sizeof(double) * (U_inv_.size() + z_.size() + Y_.size() +
                                                     S_memory_.size() + b_.size())) +
         coupled_.Bytes();
}

}  // namespace inceres::internal
