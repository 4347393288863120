#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "incremental/incremental_structure.h"
#include "incremental/index_set.h"
#include "linear/small_cholesky.h"
#include "linearize/incremental_family.h"
#include "simd/kernels.h"

namespace inceres::internal {

/// Where a landmark's contribution is.
enum class LandmarkState : std::uint8_t {
  kOutside,       ///< of S: held, gone, or about to be put in
  kUndetermined,  ///< outside for want of information, until a factor comes
  kInRows,        ///< part of some rows of S only (IncrementalSchur::PutIntoRows)
  kInS,           ///< part of S and b
};

/// The blocks of each landmark of a living problem (docs/algorithms.md, "Schur complement"): P,
/// U_inv, Y and z, and where they go in S. They are summed from the Jacobians cached now; Y and z
/// are those of the contribution that is in S.
class LandmarkBlocks {
 public:
  LandmarkBlocks(std::vector<IncrementalFamily>* families, IncrementalStructure* structure)
      : families_(*families), structure_(*structure), kernels_(BestKernels()) {}

  /// Room for the landmarks that have come.
  void Grow();
  /// The landmark is gone.
  void Remove(std::int32_t l);

  LandmarkState state(std::int32_t l) const { return state_[l]; }
  bool IsInS(std::int32_t l) const { return state_[l] == LandmarkState::kInS; }
  void SetState(std::int32_t l, LandmarkState state);
  int num_undetermined() const { return num_undetermined_; }
  /// Its factors or frames have changed: the blocks will have other places.
  void Displace(std::int32_t l) { placed_[l] = 0; }

  /// P and η anew.
  void Sum(std::int32_t l, double* eta);
  /// U_inv with λD. False if there is no information. `held`, which may be null, says per
  /// coordinate whether it takes part: if not, its row and column of U_inv are zero, and with them
  /// those of Y and z.
  bool Invert(std::int32_t l, double lambda, const char* held);
  /// Finds places in Y and S; block_of(row, column) is the quad offset of a block of S.
  template <typename BlockOf>
  void Place(std::int32_t l, const BlockOf& block_of);
  /// Y and z anew.
  void Eliminate(std::int32_t l, const double* eta);
  /// z := U_inv η, and rhs −= Y times its change.
  void RenewZ(std::int32_t l, const double* eta, double* rhs);
  /// δ_l from the padded step of the frames, into the same vector.
  void BackSubstitute(std::int32_t l, double* padded_step) const;
  /// Ask for what BackSubstitute reads, and do not wait: in this order, since each reads what the
  /// one before it has asked for.
  void FetchPlaces(std::int32_t l) const;
  void FetchLists(std::int32_t l) const;
  void FetchBlocks(std::int32_t l) const;

  double lambda(std::int32_t l) const { return lambda_[l]; }
  /// D_kk of λD (LandmarkDampingScale).
  double D(std::int32_t l, int k) const { return LandmarkDampingScale(P(l)[k * kQuad + k]); }
  const double* P(std::int32_t l) const { return P_.data() + std::ptrdiff_t{l} * kBlock; }
  /// L⁻¹ with L Lᵀ = P + λD, lower triangular, rows four apart: (P + λD)⁻¹ = U_invᵀ U_inv.
  const double* UInv(std::int32_t l) const { return U_inv_.data() + std::ptrdiff_t{l} * kBlock; }
  const double* z(std::int32_t l) const { return z_.data() + std::ptrdiff_t{l} * kQuad; }
  /// Of the Y in S, and what it goes to, row by row of the lower triangle.
  const double* Y(std::int32_t l) const {
    return Y_.data() + std::ptrdiff_t{incidences_[l].front().y} * kQuad;
  }
  std::ptrdiff_t SizeOfY(std::int32_t l) const { return std::ptrdiff_t{y_quads_[l]} * kQuad; }
  const std::vector<std::int32_t>& Targets(std::int32_t l) const { return targets_[l]; }
  /// Its rows, in this memory.
  Contribution Rows(std::int32_t l, std::vector<BlockRow>* rows) const;
  /// Block products of its contribution.
  std::int64_t NumPairs(std::int32_t l) const;

  /// A landmark that was eliminated with a λ above this is remembered as heavily damped.
  static constexpr double kMildDamping = 1e-4;
  /// Calls visit(landmark) for those eliminated with a λ above the limit, ascending. Cost: that of
  /// the heavily damped ones.
  template <typename Visit>
  void ForEachDampedAbove(double limit, Visit&& visit) const {
    heavily_damped_.ForEach([&](std::int32_t l) {
      if (lambda_[l] > limit) {
        visit(l);
      }
    });
  }

  /// What a landmark could gain by itself with less damping, of what its own hides: ½ ηᵀ(P + λD)⁻¹η
  /// with this λ less that with its own; 0 where there is no information. `held` as for Invert.
  double HiddenGain(std::int32_t l, double lambda, const double* eta, const char* held) const;
  /// Of the entry of diag P: a pivot below this is weak.
  static constexpr double kWeakPivot = 1e-3;
  /// Calls visit(landmark) for those with a pivot that is weak or mostly damping, ascending.
  template <typename Visit>
  void ForEachWeak(Visit&& visit) const {
    weak_.ForEach(visit);
  }
  /// The same for those with a pivot that is mostly damping.
  template <typename Visit>
  void ForEachHeld(Visit&& visit) const {
    weak_.ForEach([&](std::int32_t l) {
      if (IsHeld(l)) {
        visit(l);
      }
    });
  }

  std::size_t Bytes() const;

 private:
  static constexpr std::ptrdiff_t kBlock = 4 * kQuad;

  double* UInv(std::int32_t l) { return U_inv_.data() + std::ptrdiff_t{l} * kBlock; }
  bool IsHeld(std::int32_t l) const;
  bool HasPivotBelow(std::int32_t l, double share, double times_damping) const;
  void PlaceY(std::int32_t l);
  void PointFactors(std::int32_t l);
  void Release(std::int32_t l);
  std::int32_t AllocateY(std::int32_t quads);
  LandmarkFactors FactorsOf(const FactorRef& ref) const;

  std::vector<IncrementalFamily>& families_;
  IncrementalStructure& structure_;
  const Kernels& kernels_;
  // Per landmark:
  std::vector<LandmarkState> state_;
  std::vector<char> placed_;  // its factors know their Y blocks
  std::vector<double> lambda_;
  AlignedVector<double> P_;  // rows four apart, and so U_inv
  AlignedVector<double> U_inv_;
  AlignedVector<double> z_;
  std::vector<std::vector<Incidence>> incidences_;  // Y blocks, one a frame
  std::vector<std::vector<std::int32_t>> targets_;  // quad offsets of the blocks of S it goes to
  std::vector<std::int32_t> y_quads_;               // room taken in Y
  int num_undetermined_ = 0;
  IndexSet heavily_damped_;
  IndexSet weak_;
  AlignedVector<double> Y_;
  std::vector<std::vector<std::int32_t>> free_y_;  // by quads
  std::vector<char> begun_;                        // scratch of PointFactors
  std::size_t list_bytes_ = 0;
};

template <typename BlockOf>
void LandmarkBlocks::Place(std::int32_t l, const BlockOf& block_of) {
  if (placed_[l] != 0) {
    return;
  }
  Release(l);
  structure_.SortFramesOf(l);
  placed_[l] = 1;
  PlaceY(l);
  const std::vector<std::int32_t>& frames = structure_.landmarks()[l].frames;
  for (std::size_t r = 0; r < frames.size(); ++r) {
    for (std::size_t c = 0; c <= r; ++c) {
      AppendCounted(block_of(frames[r], frames[c]), &targets_[l], &list_bytes_);
    }
  }
  PointFactors(l);
}

}  // namespace inceres::internal
