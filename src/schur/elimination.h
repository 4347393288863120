#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "base/zeroed_array.h"
#include "linearize/block_scratch.h"
#include "linearize/hessian.h"
#include "schur/coupled_products.h"

namespace inceres::internal {

/// How much memory an elimination may do without.
struct EliminationMemory {
  /// Where S is formed, as the plans' pattern has its blocks; null: in memory of its own.
  double* S = nullptr;
  /// Of many landmarks U_inv and z are found again on the way back, and not kept: there is no UInv
  /// and no SubtractReduced.
  bool may_forget_landmarks = false;
};

/// Eliminates the landmarks from (H + Λ) δ = η (docs/algorithms.md, "Schur complement"):
///
///     [ P + Λ_l   Wᵀ      ] [δ_l]   [l]    U_invᵀ U_inv = (P + Λ_l)⁻¹,  Y = W U_invᵀ,  z = U_inv l
///     [ W         C + Λ_c ] [δ_c] = [c]    S = C − Y Yᵀ,  b = c − Y z,  δ_l = U_invᵀ (z − Yᵀ δ_c)
///
/// Λ_c is left to the factorization of S. Each block of S is accumulated in registers over all
/// landmarks of a chunk that its two frames share: where all landmarks are one chunk, S is written
/// once and never read back. Y is kept for one chunk at a time; where there are more, the way back
/// takes Wᵀδ_c from the Jacobians, and so does b where no block of S is formed. Jacobians that are
/// not kept are brought chunk by chunk. Source: Triggs et al. 1999, section 6.1.
class Elimination {
 public:
  Elimination(const Evaluator& evaluator, const LandmarkIncidences& incidences,
              const FramePlans& plans, const Hessian& hessian,
              const EliminationMemory& memory = {});

  /// Forms S and b with Λ_l = diag(landmark_damping) (packed, landmarks only), which stays where it
  /// is until the way back. kSingular names the variable whose block P + Λ_l has no Cholesky
  /// factor.
  Status Eliminate(const double* landmark_damping);

  /// Values of S in the pattern of the frame system.
  const double* S() const { return S_; }
  const double* b() const { return b_.data(); }
  /// U_inv of landmark l: rows four apart.
  const double* UInv(int l) const { return U_inv_.data() + Kept(l) * stride_; }
  /// Rows of Y_li, where Y is whole: of one chunk, without a tail.
  const double* Y(const Incidence& incidence) const {
    return Y_.data() + std::ptrdiff_t{incidence.y} * kQuad;
  }

  /// δ_l (packed, landmarks only) from δ_c (packed). The Jacobians must still be those of
  /// Eliminate.
  void BackSubstitute(const double* frame_step, double* landmark_step) {
    BackSubstitute(0, incidences_.num_landmarks(), frame_step, landmark_step);
  }
  /// The same of the landmarks from first to last alone, those of a chunk where Jacobians are not
  /// kept: one after the other from landmark 0 on, with the same frame_step.
  void BackSubstitute(int first, int last, const double* frame_step, double* landmark_step);

  /// y −= S v over the frames, padded, without their damping. From the Jacobians, which must still
  /// be those of Eliminate; no block of S is read. Not by two threads at once. Cost: a pass over
  /// the Jacobians.
  void SubtractReduced(const double* v, double* y) const {
    coupled_.SubtractReduced(v, U_inv_.data(), y);
  }

  std::int64_t Bytes() const;

 private:
  // A block of S that a chunk adds to: all of them for the first chunk, which begins them.
  struct ChunkBlock {
    int block;
    int first_segment;  // of the chunk, if it has one there
  };
  // Where U_inv and z of a landmark are among those that are there.
  std::ptrdiff_t Kept(int landmark) const { return landmark - first_kept_; }
  void TakeMemory(const EliminationMemory& memory);
  void CollectChunkBlocks();
  bool IsOfChunk(int chunk, std::size_t block, int segment) const;
  // U_inv; false if the block is singular
  bool Factorize(int landmark, double* U_inv) const;
  void EliminateLandmark(int landmark);  // z and Y by it
  void FormBlocks(int chunk, int begin, int end);
  void FormBlock(int chunk, const ChunkBlock& place, BlockScratch* scratch);
  void FormRightHandSide(int chunk, const ChunkBlock& place, BlockScratch* scratch);
  void BackSubstituteLandmark(int landmark, double* landmark_step) const;
  void TakeRightHandSideFromJacobians();
  int DampingOffset(int landmark) const;

  const Evaluator& evaluator_;
  const LandmarkIncidences& incidences_;
  const FramePlans& plans_;
  const Hessian& hessian_;
  const Kernels& kernels_;
  const std::ptrdiff_t stride_;  // from U_inv to U_inv: as many quads as the largest has rows
  ZeroedArray U_inv_;            // per landmark: rows four apart
  ZeroedArray z_;                // per landmark: four entries
  bool keeps_landmarks_ = true;  // else both are of one chunk
  int first_kept_ = 0;
  const double* landmark_damping_ = nullptr;
  ZeroedArray Y_;         // of one chunk
  ZeroedArray S_memory_;  // mostly empty
  double* S_;
  std::vector<double> b_;
  AlignedVector<double> padded_frame_step_;
  std::vector<ChunkBlock> chunk_blocks_;  // by chunk, then block
  std::vector<int> chunk_blocks_begin_;   // per chunk, and one more
  mutable CoupledProducts coupled_;
  const bool keeps_all_;  // not where all that is asked for comes from the Jacobians
};

}  // namespace inceres::internal
