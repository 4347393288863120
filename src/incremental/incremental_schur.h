#pragma once

#include <cstdint>
#include <vector>

#include "incremental/active_bounds.h"
#include "incremental/incremental_structure.h"
#include "incremental/index_set.h"
#include "incremental/landmark_blocks.h"
#include "incremental/landmark_gains.h"
#include "incremental/schur_sums.h"
#include "linearize/incremental_family.h"

namespace inceres::internal {

/// S and b of a living problem, kept up by difference (docs/algorithms.md, "Incremental Schur
/// complement"):
///
///     S = Σ_factors J_cᵀJ_c − Σ_landmarks Y Yᵀ,   b = −Σ_factors J_cᵀq − Σ_landmarks Y z
///
/// A landmark's contribution goes out with the Y and z it went in with: its blocks P and η are
/// re-summed from the cached Jacobians, and the new contribution takes the place of the old in one
/// pass over S. So it is with a factor's. The rows touched since the last factorization are
/// remembered, for the factor resumes at the first of them. A constant is a mask: a held frame
/// keeps its row, a held landmark its blocks outside S.
///
/// Drift: adding and subtracting leaves ε times the largest value an entry ever held. A frame whose
/// diagonal of C has shrunk far below its peak, or whose b has been far above what the cost allows
/// now, is summed anew from the caches (ResumDrifted).
class IncrementalSchur {
 public:
  using Frame = IncrementalStructure::Frame;
  using Landmark = IncrementalStructure::Landmark;

  IncrementalSchur(std::vector<IncrementalFamily>* families, ActiveBounds* bounds)
      : families_(*families),
        bounds_(*bounds),
        structure_(families),
        blocks_(families, &structure_),
        sums_(families, &structure_, &blocks_) {}
  IncrementalSchur(const IncrementalSchur&) = delete;
  IncrementalSchur& operator=(const IncrementalSchur&) = delete;

  int AddFrame(VariableId id, std::int32_t quad, int size);
  int AddLandmark(VariableId id, std::int32_t quad, int size);
  /// No factor may touch it any more.
  void RemoveFrame(std::int32_t frame);
  void RemoveLandmark(std::int32_t landmark);
  /// A held frame keeps its row, for the solver of S to leave out; a held landmark is taken out,
  /// and put in again by PutIn.
  void HoldFrame(std::int32_t frame, bool held);
  void HoldLandmark(std::int32_t landmark, bool held);
  /// When the frame is eliminated, see SymmetricBlockRows::SetGroup.
  void SetFrameGroup(std::int32_t frame, int group);

  /// Registers a factor with its frames (indices, -1 where none) and landmark (or -1). Its
  /// contribution is added later.
  void Connect(FactorRef ref, const std::int32_t* frames, std::int32_t landmark);
  /// Forgets it; neither its contribution nor its landmark's is in S.
  void Disconnect(FactorRef ref);

  /// Frame part of a factor's share of S and b, with the Jacobians cached now: sign +1 adds, -1
  /// takes out.
  void AddFactor(FactorRef ref, double sign) { sums_.AddFactor(ref, sign); }
  /// The same with Jacobians about to change: KeepFactor before, ReplaceFactor after, with what it
  /// gave. DropKept ends the lot.
  std::ptrdiff_t KeepFactor(FactorRef ref) { return sums_.KeepFactor(ref); }
  void ReplaceFactor(FactorRef ref, std::ptrdiff_t kept) { sums_.ReplaceFactor(ref, kept); }
  void DropKept() { sums_.DropKept(); }
  /// Takes the landmark's contribution out of S and b, if it is there: before factors are connected
  /// or disconnected, or for good.
  void TakeOut(std::int32_t landmark);
  /// Re-sums P and η, decides which coordinates are held at bounds, eliminates with λD, and
  /// puts the contribution in, in place of the one that is there; leaves a landmark without
  /// information outside, and a held one too.
  void PutIn(std::int32_t landmark, double lambda);
  /// The same of a landmark that is not in S, but into the blocks and entries of these rows alone;
  /// and out of them again.
  void PutIntoRows(std::int32_t landmark, double lambda, const IndexSet& rows);
  void TakeOutOfRows(std::int32_t landmark, const IndexSet& rows);
  /// η takes over its change, z is renewed, and b follows. Who touches b otherwise says so.
  void RefreshResidual(std::int32_t landmark);

  /// Frames touched since the last call, or all when the cost has fallen far since, are re-summed
  /// where cancellation has eaten digits: of S and C against C, of b against √(C · 2 cost). Returns
  /// how many.
  int ResumDrifted(double cost);
  /// S and b from the caches: every factor, and every landmark with the Y and z it has. Between the
  /// two calls contributions taken out are only forgotten: nothing of the old S and b is read.
  void BeginRebuild() { rebuilding_ = true; }
  void Rebuild();

  const SymmetricBlockRows& S() const { return sums_.S(); }
  /// The frame's entries of diag(C).
  const double* FrameDiagonal(int frame) const {
    return sums_.vectors().diagonal(frames()[frame].quad);
  }
  /// In a vector packed by rows; that of the row after the last is the vector's size.
  int FrameOffset(int frame) const { return offsets_[frame]; }
  /// All of these, by row, and the size.
  const std::vector<int>& offsets() const { return offsets_; }
  int size() const { return offsets_.back(); }
  /// What a step under trial does to b and η, by quads: zero but for what whoever tries the step
  /// has written. TakeChange and RefreshResidual take it over and DropFrameChange or
  /// DropLandmarkChange forgets it, variable by variable.
  double* padded_change() { return sums_.vectors().change(); }
  void TakeChange(int frame);
  void DropFrameChange(int frame) {
    sums_.vectors().DropChange(frames()[frame].quad, frames()[frame].size);
  }
  void DropLandmarkChange(int landmark) {
    sums_.vectors().DropChange(landmarks()[landmark].quad, landmarks()[landmark].size);
  }
  const double* b(int frame) const { return sums_.vectors().rhs(frames()[frame].quad); }
  const double* eta(int landmark) const { return sums_.vectors().rhs(landmarks()[landmark].quad); }

  const IncrementalStructure& structure() const { return structure_; }
  const std::vector<Frame>& frames() const { return structure_.frames(); }
  const std::vector<Landmark>& landmarks() const { return structure_.landmarks(); }
  const LandmarkBlocks& blocks() const { return blocks_; }
  /// ActiveBounds::held of the variable with this quad.
  const char* HeldAtBounds(std::int32_t quad) const { return bounds_.held(quad); }
  /// ½ ηᵀ(P + λD)⁻¹η; 0 outside S.
  const LandmarkGains& gains() const { return gains_; }
  LandmarkGains& gains() { return gains_; }
  bool IsInS(std::int32_t landmark) const { return blocks_.IsInS(landmark); }
  /// Largest entry and norm of (b, η) over what can move, bounds considered. Cost: a pass over all.
  void RhsNorms(double* max_norm, double* norm) const;

  /// What has changed of S and b, held frames included, for those who follow them.
  RowChanges& changes() { return sums_.changes(); }
  /// Block products of all landmark contributions in S.
  std::int64_t NumPairs() const { return num_pairs_; }
  std::int64_t Bytes() const;

 private:
  void UpdateOffsets(std::int32_t first);
  void Eliminate(std::int32_t landmark);
  bool Invert(std::int32_t landmark, double lambda);
  void LeaveOutside(std::int32_t landmark);
  void ResumFrame(std::int32_t frame);
  void RenewGain(std::int32_t landmark);

  std::vector<IncrementalFamily>& families_;
  ActiveBounds& bounds_;
  IncrementalStructure structure_;
  LandmarkBlocks blocks_;
  LandmarkGains gains_;
  SchurSums sums_;
  std::vector<int> offsets_{0};
  std::int64_t num_pairs_ = 0;
  bool rebuilding_ = false;
  double drift_cost_ = 0.0;  // when all rows were looked at
  std::vector<std::int32_t> scratch_;
};

}  // namespace inceres::internal
