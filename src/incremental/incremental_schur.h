#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "base/aligned_vector.h"
#include "incremental/index_set.h"
#include "linear/block_rows.h"
#include "linearize/incremental_family.h"

namespace inceres::internal {

struct FactorRef {
  std::int32_t family;
  std::int32_t factor;
};
inline bool operator==(const FactorRef& a, const FactorRef& b) {
  return a.family == b.family && a.factor == b.factor;
}

/// S and b of a living problem, kept up by difference (docs/algorithms.md, "Incremental Schur complement"):
///
///     S = Σ_factors J_cᵀJ_c − Σ_landmarks Y Yᵀ,   b = −Σ_factors J_cᵀq − Σ_landmarks Y z
///
/// A landmark's contribution goes out with the Y and z it went in with: its blocks P and η are re-summed from the cached
/// Jacobians, and the new contribution takes the place of the old in one pass over S. So it is with a factor's. Frames are block
/// rows in order of arrival, the row of a removed one serves a later one once there are many; the rows touched since the last
/// factorization are remembered, for the factor resumes at the first of them. A constant is a mask: a held frame keeps its row, a
/// held landmark its blocks outside S.
///
/// Drift: adding and subtracting leaves ε times the largest value an entry ever held. A frame whose diagonal of C has shrunk far
/// below its peak, or whose b has been far above what the cost allows now, is summed anew from the caches (ResumDrifted).
class IncrementalSchur {
 public:
  struct Frame {
    VariableId id = -1;      // -1: a free row
    std::int32_t quad = -1;  // of its step
    int size = 0;
    bool held = false;
    std::vector<FactorRef> factors;       // those that touch no landmark
    std::vector<std::int32_t> landmarks;  // which have the others
  };
  struct Landmark {
    VariableId id = -1;  // -1: a free place
    std::int32_t quad = -1;
    int size = 0;
    bool in_S = false;          // its contribution is part of S and b
    bool undetermined = false;  // no information: left alone until a factor comes
    bool held = false;
    bool placed = false;  // its factors know their Y blocks
    bool partly = false;  // eliminated, but its contribution is part of some rows only (PutIntoRows)
    double lambda = 0.0;
    std::vector<FactorRef> factors;
    std::vector<std::int32_t> frames;   // its separator
    std::vector<std::int32_t> places;   // where each of them lists this landmark
    std::vector<Incidence> incidences;  // Y blocks, one a frame, of the contribution in S
    std::vector<std::int32_t> blocks;   // quad offsets of the blocks of S it goes to, row by row of its lower triangle
    std::int32_t y_quads = 0;           // room taken in Y
    alignas(32) double P[4 * kQuad];
    alignas(32) double U_inv[4 * kQuad];
    double z[kQuad];
  };

  explicit IncrementalSchur(std::vector<IncrementalFamily>* families) : families_(*families), kernels_(BestKernels()) {}

  int AddFrame(VariableId id, std::int32_t quad, int size);
  int AddLandmark(VariableId id, std::int32_t quad, int size);
  /// No factor may touch it any more.
  void RemoveFrame(std::int32_t frame);
  void RemoveLandmark(std::int32_t landmark);
  /// A held frame keeps its row, for the solver of S to leave out; a held landmark is taken out, and put in again by PutIn.
  void HoldFrame(std::int32_t frame, bool held);
  void HoldLandmark(std::int32_t landmark, bool held);

  /// Registers a factor with its frames (indices, -1 where none) and landmark (or -1). Its contribution is added later.
  void Connect(FactorRef ref, const std::int32_t* frames, std::int32_t landmark);
  /// Forgets it; neither its contribution nor its landmark's is in S.
  void Disconnect(FactorRef ref);

  /// Frame part of a factor's share of S and b, with the Jacobians cached now: sign +1 adds, -1 takes out.
  void AddFactor(FactorRef ref, double sign);
  /// The same with Jacobians about to change: KeepFactor before, ReplaceFactor after, with what it gave. DropKept ends the lot.
  std::ptrdiff_t KeepFactor(FactorRef ref);
  void ReplaceFactor(FactorRef ref, std::ptrdiff_t kept);
  void DropKept() { num_kept_ = 0; }
  /// Takes the landmark's contribution out of S and b, if it is there: before factors are connected or disconnected, or for good.
  void TakeOut(std::int32_t landmark);
  /// Re-sums P and η, eliminates with λ diag(P), and puts the contribution in, in place of the one that is there; parks a
  /// landmark without information. A held landmark stays outside.
  void PutIn(std::int32_t landmark, double lambda);
  /// The same of a landmark that is not in S, but into the blocks and entries of these rows alone; and out of them again.
  void PutIntoRows(std::int32_t landmark, double lambda, const IndexSet& rows);
  void TakeOutOfRows(std::int32_t landmark, const IndexSet& rows);
  /// η takes over its change, z is renewed, and b follows. Who touches b otherwise says so.
  void RefreshResidual(std::int32_t landmark);

  /// Frames touched since the last call, or all when the cost has fallen far since, are re-summed where cancellation has eaten
  /// digits: of S and C against C, of b against √(C · 2 cost). Returns how many.
  int ResumDrifted(double cost);
  /// S and b from the caches: every factor, and every landmark with the Y and z it has.
  /// Between the two calls contributions taken out are only forgotten: nothing of the old S and b is read.
  void BeginRebuild() { rebuilding_ = true; }
  void Rebuild();

  /// δ_l from the padded step of the frames, into the same vector.
  void BackSubstitute(std::int32_t landmark, double* padded_step) const;

  const SymmetricBlockRows& S() const { return S_; }
  /// The frame's entries of diag(C).
  const double* FrameDiagonal(int frame) const { return C_diagonal_.data() + std::ptrdiff_t{frames_[frame].quad} * kQuad; }
  /// In a vector packed by rows; that of the row after the last is the vector's size.
  int FrameOffset(int frame) const { return offsets_[frame]; }
  int size() const { return offsets_.back(); }
  /// One vector for all variables, by their quads: b for frames, η for landmarks.
  double* padded_rhs() { return rhs_.data(); }
  /// What a step under trial does to it: zero but for what whoever tries the step has written. TakeChange and RefreshResidual
  /// take it over and DropChange forgets it, variable by variable.
  double* padded_change() { return rhs_change_.data(); }
  void TakeChange(int frame);
  void DropFrameChange(int frame) { ZeroChange(frames_[frame].quad, frames_[frame].size); }
  void DropLandmarkChange(int landmark) { ZeroChange(landmarks_[landmark].quad, landmarks_[landmark].size); }
  const double* b(int frame) const { return rhs_.data() + std::ptrdiff_t{frames_[frame].quad} * kQuad; }
  const double* eta(int landmark) const { return rhs_.data() + std::ptrdiff_t{landmarks_[landmark].quad} * kQuad; }

  const std::vector<Frame>& frames() const { return frames_; }
  const std::vector<Landmark>& landmarks() const { return landmarks_; }
  int num_frames() const { return num_frames_; }
  int num_landmarks() const { return num_landmarks_; }
  int num_undetermined() const { return num_undetermined_; }
  std::int32_t FrameOfFactor(FactorRef ref, int slot) const { return frame_of_slot_[ref.family][Slot(ref, slot)]; }
  bool Touches(FactorRef ref, std::int32_t frame) const {
    const std::int32_t* begin = frame_of_slot_[ref.family].data() + Slot(ref, 0);
    const std::int32_t* end = begin + families_[ref.family].num_slots();
    return std::find(begin, end, frame) != end;
  }
  /// Calls visit(frame) for the factor's frames.
  template <typename Visit>
  void ForEachFrameOf(FactorRef ref, Visit&& visit) const {
    for (int s = 0; s < families_[ref.family].num_slots(); ++s) {
      if (FrameOfFactor(ref, s) >= 0) {
        visit(FrameOfFactor(ref, s));
      }
    }
  }
  /// Calls visit(ref) for the factors that touch both.
  template <typename Visit>
  void ForEachFactorBetween(std::int32_t landmark, std::int32_t frame, Visit&& visit) const {
    for (const FactorRef& ref : landmarks_[landmark].factors) {
      if (Touches(ref, frame)) {
        visit(ref);
      }
    }
  }
  std::int32_t LandmarkOfFactor(FactorRef ref) const { return landmark_of_[ref.family][ref.factor]; }

  /// ½ ηᵀ(P + λD)⁻¹η: what the landmark could still gain by itself; 0 outside S.
  double decrement(int landmark) const { return decrements_[landmark]; }
  /// Their sum. Kept by difference, and summed anew when rounding may have eaten more than `accuracy`.
  double TotalDecrement(double accuracy);
  /// Largest entry and norm of (b, η) over what can move. Cost: a pass over all variables.
  void RhsNorms(double* max_norm, double* norm) const;
  /// Landmarks whose decrement may be above the threshold. Cheap while the threshold does not fall far.
  const std::vector<std::int32_t>& EagerLandmarks(double threshold);

  /// A landmark that was eliminated with a λ above this is remembered as heavily damped.
  static constexpr double kMildDamping = 1e-4;
  /// Calls visit(landmark) for those eliminated with a λ above the limit, ascending. Cost: that of the heavily damped ones.
  template <typename Visit>
  void ForEachDampedAbove(double limit, Visit&& visit) const {
    heavily_damped_.ForEach([&](std::int32_t l) {
      if (landmarks_[l].lambda > limit) {
        visit(l);
      }
    });
  }

  /// The rows of S touched since the last call, ascending; the vector's memory is used again.
  void TakeChangedRows(std::vector<std::int32_t>* rows) { Take(&changed_rows_, rows); }
  /// The same for whoever factors S, and for entries of b. Whoever writes the padded right-hand side himself says so.
  void TakeUnfactoredRows(std::vector<std::int32_t>* rows) { Take(&unfactored_rows_, rows); }
  void TakeUnsolvedRows(std::vector<std::int32_t>* rows) { Take(&unsolved_rows_, rows); }
  /// And for whoever packs b and the diagonals: also rows that are held now or no longer, or have another offset.
  void TakeUnreadRows(std::vector<std::int32_t>* rows) { Take(&unread_rows_, rows); }
  void TouchB(std::int32_t row) {
    unsolved_rows_.Add(row);
    unread_rows_.Add(row);
    touched_.Add(row);
  }
  /// Block products of all landmark contributions in S, and of one landmark's.
  std::int64_t NumPairs() const { return num_pairs_; }
  std::int64_t NumPairs(std::int32_t landmark) const;
  std::int64_t Bytes() const;

 private:
  template <typename T>
  void Append(std::vector<T>* list, const T& value) {
    const std::size_t before = list->capacity();
    list->push_back(value);
    list_bytes_ += sizeof(T) * (list->capacity() - before);
  }
  std::size_t Slot(FactorRef ref, int slot) const {
    return static_cast<std::size_t>(ref.factor) * families_[ref.family].num_slots() + slot;
  }
  void AddChange(std::int32_t quad, int size);
  void ZeroChange(std::int32_t quad, int size) {
    std::fill_n(rhs_change_.begin() + std::ptrdiff_t{quad} * kQuad, PadToQuad(size), 0.0);
  }
  double* Rhs(std::int32_t quad) { return rhs_.data() + std::ptrdiff_t{quad} * kQuad; }
  void MakeRoom(std::int32_t quad, int size);
  void Unlist(std::int32_t frame, std::int32_t place);
  void Separate(std::int32_t landmark, std::int32_t frame);
  void UpdateOffsets(std::int32_t first);
  void AddFactorToRow(FactorRef ref, std::int32_t only);
  const std::int32_t* BlocksOfFactor(FactorRef ref);
  Contribution RowsOfFactor(FactorRef ref);
  Contribution RowsOfLandmark(const Landmark& landmark);
  void AddRows(const Contribution& contribution, const double* q, const double* q_out, double sign, const std::int32_t* blocks);
  void AddContribution(const Landmark& landmark, double sign);
  void ReplaceContribution(const Landmark& landmark, const double* Y_out, const double* z_out);
  double* KeepRoom(std::ptrdiff_t count);
  void SubtractLandmarkFromRow(const Landmark& landmark, std::int32_t only);
  void AddToRows(const Landmark& landmark, double sign, const IndexSet& rows);
  bool InvertDamped(std::int32_t landmark, double lambda);
  void SortFrames(Landmark* landmark);
  void ZeroVectors(const Frame& frame);
  // Quad offset of a block of S, row ≥ column.
  std::int32_t BlockOf(std::int32_t row, std::int32_t column) {
    return static_cast<std::int32_t>(S_.FindOrAdd(row, column) / kQuad);
  }
  void ResumFrame(std::int32_t frame);
  void PlaceBlocks(std::int32_t landmark);
  void ReleaseBlocks(Landmark* landmark);
  void SumLandmark(Landmark* landmark);
  void EliminateLandmark(Landmark* landmark);
  void RenewDecrement(std::int32_t landmark);
  LandmarkFactors FactorsOf(const FactorRef& ref) const;
  static void Take(IndexSet* set, std::vector<std::int32_t>* rows) {
    set->CopyTo(rows);
    set->Clear();
  }
  void Touch(std::int32_t row) {
    changed_rows_.Add(row);
    unfactored_rows_.Add(row);
    TouchB(row);
  }
  bool HasDrifted(std::int32_t row, double cost);
  void SampleB(std::int32_t row);
  std::int32_t AllocateY(std::int32_t quads);

  std::vector<IncrementalFamily>& families_;
  const Kernels& kernels_;
  std::vector<Frame> frames_;
  std::vector<Landmark> landmarks_;
  std::vector<std::int32_t> free_rows_;
  std::vector<std::int32_t> free_landmarks_;
  int num_frames_ = 0;
  int num_landmarks_ = 0;
  int num_undetermined_ = 0;
  std::size_t list_bytes_ = 0;                             // of the lists of frames and landmarks
  std::vector<std::vector<std::int32_t>> frame_of_slot_;   // per family: per factor and slot
  std::vector<std::vector<std::int32_t>> place_in_frame_;  // the same: where the frame lists it; of factors without landmark
  std::vector<std::vector<std::int32_t>> landmark_slot_;   // per family and factor: the landmark's slot
  std::vector<std::vector<std::int32_t>> landmark_of_;     // per family and factor
  // Per family, factor and pair of its frames, ascending: quad offset of the block of S; the first -1: not looked up yet.
  std::vector<std::vector<std::int32_t>> factor_blocks_;
  SymmetricBlockRows S_;
  std::vector<int> offsets_{0};
  AlignedVector<double> rhs_;
  AlignedVector<double> rhs_change_;  // laid out as rhs_, and so the three below
  AlignedVector<double> C_diagonal_;
  AlignedVector<double> C_peak_;  // the largest C_diagonal_ has been since its row was summed
  AlignedVector<double> b_peak_;  // the largest |b| has been since its row was summed
  AlignedVector<double> Y_;
  std::vector<std::vector<std::int32_t>> free_y_;  // by quads
  std::int64_t num_pairs_ = 0;
  bool rebuilding_ = false;
  IndexSet touched_;          // rows, since ResumDrifted
  IndexSet changed_rows_;     // of S, since TakeChangedRows
  IndexSet unfactored_rows_;  // of S, since TakeUnfactoredRows
  IndexSet unsolved_rows_;    // of b, since TakeUnsolvedRows
  IndexSet unread_rows_;      // since TakeUnreadRows
  double drift_cost_ = 0.0;   // when all rows were looked at
  std::vector<std::int32_t> scratch_;
  std::vector<BlockRow> rows_;         // of the contribution under way
  AlignedVector<double> kept_;         // rows and q of factors, and Y, as they are in S
  std::ptrdiff_t num_kept_ = 0;        // entries of it in use
  std::vector<std::int32_t> rows_of_;  // their frames
  std::vector<std::int32_t> blocks_;   // those of one frame alone

  std::vector<double> decrements_;  // per landmark
  double total_decrement_ = 0.0;
  double decrement_error_ = 0.0;  // bound of its rounding error since it was summed
  double eager_threshold_ = 0.0;  // what IndexSet eager_ was collected with
  IndexSet eager_;
  IndexSet heavily_damped_;  // landmarks
  std::vector<std::int32_t> eager_list_;
};

}  // namespace inceres::internal
