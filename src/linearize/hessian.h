#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "base/zeroed_array.h"
#include "linearize/block_scratch.h"
#include "linearize/chunk_sums.h"
#include "linearize/kept_products.h"
#include "linearize/product_plan.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// H and η = −Jᵀf, undamped and unscaled, in three parts: C (frame blocks), P (one block a
/// landmark) and η. Of the pattern of the frame system C has the blocks that factors reach and the
/// diagonal ones: all of them where there are no landmarks, few where frames share landmarks only.
/// W is not stored: the elimination takes J_fᵀJ_l P⁻¹ straight from the Jacobians.
class Hessian {
 public:
  Hessian(const Evaluator& evaluator, const LandmarkIncidences& incidences,
          const FramePlans& plans);

  /// Sums H and η from the evaluator's current residuals and Jacobians. Every block and every entry
  /// is summed by one task in a fixed order. Of Jacobians that are not kept this is done while they
  /// are evaluated.
  void Accumulate();

  /// The blocks of C one after the other, in the order of the pattern.
  const ZeroedArray& C() const { return C_; }
  /// A block of the pattern, or null where C has none: all zeros.
  const double* FrameBlock(int block) const {
    return C_begin_[block] < 0 ? nullptr : C_.data() + C_begin_[block];
  }
  /// P of landmark l, its lower triangle: rows four apart.
  void GetP(int l, double* P) const;
  /// η of landmark l.
  void GetLandmarkEta(int l, double* eta) const;
  /// Jᵀf, packed: the gradient of the cost.
  const std::vector<double>& gradient() const { return gradient_; }
  /// diag(H), packed: the squared column norms of J.
  const std::vector<double>& diagonal() const { return diagonal_; }

 private:
  void PlaceFrameBlocks();
  void AccumulateFrameBlocks(int begin, int end);
  void PlanSmallBlocks();
  bool IsSmall(std::size_t block);
  void AddSmallTerms(std::size_t block);
  int SumSmallBlocks(int begin, int end);
  void AddSegment(int segment, int rows, int columns, double* sum);
  void AccumulateChunk(int chunk);
  void AddWidened(int source, const BlockProducts& products, double* out) const;
  void AccumulateGradient(int frame, BlockScratch* scratch);
  void AccumulateLandmarks(int begin, int end);
  void BuildProducts();
  // Of a landmark, in packed vectors: landmarks come behind the frames.
  int OffsetOf(int landmark) const {
    const Layout& layout = evaluator_.layout();
    return layout.packed_offset[layout.num_frames + landmark];
  }

  // What the segments of one source have in common; terms, their number and the sizes of the block
  // are a segment's own.
  struct Source {
    BlockProducts products;
    VectorProducts gradient;  // of its row slot; without v it is the evaluator's strip_gradient
    int family = 0;
    bool keeps_singles = false;  // the family does
  };

  const Evaluator& evaluator_;
  const LandmarkIncidences& incidences_;
  const FramePlans& plans_;
  const Kernels& kernels_;
  KeptProducts kept_;
  std::unique_ptr<ChunkSums> chunk_sums_;  // null: Jacobians are kept
  ZeroedArray C_;
  std::vector<std::int64_t> C_begin_;  // per block of the pattern; -1: C has none
  // Per landmark: P below the diagonal, which is in diagonal_. Each has room for the largest.
  std::ptrdiff_t below_stride_;
  ZeroedArray below_diagonal_;
  std::vector<double> gradient_;
  std::vector<double> diagonal_;
  std::vector<Source> sources_;             // of the plan
  std::vector<SmallSource> small_sources_;  // the same, for blocks of 3 × 3
  std::vector<SmallTerm> small_terms_;
  std::vector<SmallBlock> small_blocks_;  // per block; without terms: it is summed otherwise
  int small_depth_ = 0;                   // of all of them; 0: there are none
};

}  // namespace inceres::internal
