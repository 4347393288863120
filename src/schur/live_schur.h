#pragma once

#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "block/block_rows.h"
#include "linearisation/live_family.h"

namespace inceres::internal {

struct FactorRef {
  std::int32_t family;
  std::int32_t factor;
};

/// S and b of a growing problem, kept up by difference (algorithms.md section 2, algorithms 3 and 4):
///
///     S = Σ_factors J_cᵀJ_c − Σ_landmarks Y Yᵀ,   b = −Σ_factors J_cᵀq − Σ_landmarks Y z
///
/// A landmark's contribution is taken out with the Y and z it went in with, its blocks P and η are re-summed from the cached
/// Jacobians, and the new contribution goes in. Frames are block rows in order of arrival; the smallest row touched since the
/// last factorisation is remembered, for the factor resumes there.
class LiveSchur {
 public:
  struct Frame {
    VariableId id;
    std::int32_t quad;  // of its step
    int size;
    std::vector<FactorRef> factors;
  };
  struct Landmark {
    VariableId id;
    std::int32_t quad;
    int size;
    bool in_S = false;    // its contribution is part of S and b
    bool parked = false;  // no information: left alone until a factor comes
    double lambda = 0.0;
    double decrement = 0.0;  // ½ lᵀ(P + λD)⁻¹l: what the landmark could still gain by itself
    std::vector<FactorRef> factors;
    std::vector<std::int32_t> frames;   // its separator
    std::vector<Incidence> incidences;  // Y blocks, one a frame
    std::size_t num_placed = 0;         // factors that know their Y blocks
    std::int32_t y_quads = 0;           // room taken in Y
    alignas(32) double P[4 * kQuad];
    alignas(32) double U_inv[4 * kQuad];
    double eta[kQuad];
    double z[kQuad];
  };

  explicit LiveSchur(std::vector<LiveFamily>* families) : families_(*families), kernels_(BestKernels()) {}

  int AddFrame(VariableId id, std::int32_t quad, int size);
  int AddLandmark(VariableId id, std::int32_t quad, int size);
  /// Registers a new factor with its frames (indices, -1 where none) and landmark (or -1). Its contribution is added later.
  void Connect(FactorRef ref, const std::int32_t* frames, std::int32_t landmark);

  /// Frame part of a factor's share of S, b and the gradient, with the Jacobians cached now: sign +1 adds, -1 takes out.
  void AddFactor(FactorRef ref, double sign);
  /// The factor's q has changed by q_change: its share of the frames' b and gradient follows.
  void ChangeResidual(FactorRef ref, const double* q_change);

  /// Takes the landmark's contribution out of S and b, if it is there.
  void TakeOut(std::int32_t landmark);
  /// Re-sums P and η, eliminates with λ diag(P), and puts the contribution in; parks a landmark without information.
  void PutIn(std::int32_t landmark, double lambda);
  /// Only residuals changed: η and z are renewed and b follows.
  void RefreshResidual(std::int32_t landmark);

  /// δ_l from the padded step of the frames, into the same vector.
  void BackSubstitute(std::int32_t landmark, double* padded_step) const;

  const SymmetricBlockRows& S() const { return S_; }
  /// b and diag(C), packed by block rows.
  const std::vector<double>& b() const { return b_; }
  const std::vector<double>& FrameDiagonal() const { return C_diagonal_; }
  int FrameOffset(int frame) const { return offsets_[frame]; }

  const std::vector<Frame>& frames() const { return frames_; }
  const std::vector<Landmark>& landmarks() const { return landmarks_; }
  std::int32_t FrameOfFactor(FactorRef ref, int slot) const { return frame_of_slot_[ref.family][Slot(ref, slot)]; }
  std::int32_t LandmarkOfFactor(FactorRef ref) const { return landmark_of_[ref.family][ref.factor]; }

  /// Smallest block row touched since the last call; num_rows if none.
  int TakeFirstChanged();

 private:
  std::size_t Slot(FactorRef ref, int slot) const {
    return static_cast<std::size_t>(ref.factor) * families_[ref.family].num_slots() + slot;
  }
  void AddToS(const Landmark& landmark, double sign);
  void AddToB(const Landmark& landmark, const double* z, double sign);
  void PlaceBlocks(std::int32_t landmark);
  void SumLandmark(Landmark* landmark);
  void EliminateLandmark(Landmark* landmark);
  LandmarkFactors FactorsOf(const FactorRef& ref) const;
  void Touch(int row) { first_changed_ = row < first_changed_ ? row : first_changed_; }
  std::int32_t AllocateY(std::int32_t quads);
  void ReleaseY(std::int32_t offset, std::int32_t quads);

  std::vector<LiveFamily>& families_;
  const Kernels& kernels_;
  std::vector<Frame> frames_;
  std::vector<Landmark> landmarks_;
  std::vector<std::vector<std::int32_t>> frame_of_slot_;  // per family: per factor and slot
  std::vector<std::vector<std::int32_t>> landmark_slot_;  // per family and factor: the landmark's slot
  std::vector<std::vector<std::int32_t>> landmark_of_;    // per family and factor
  SymmetricBlockRows S_;
  std::vector<int> offsets_{0};
  std::vector<double> b_;
  std::vector<double> C_diagonal_;
  AlignedVector<double> Y_;
  std::vector<std::vector<std::int32_t>> free_y_;  // by quads
  int first_changed_ = 0;
};

}  // namespace inceres::internal
