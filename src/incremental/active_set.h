#pragma once

#include <cstdint>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "incremental/incremental_system.h"
#include "incremental/index_set.h"
#include "incremental/partial_step.h"
#include "incremental/reduced_vectors.h"
#include "incremental/tuning.h"

namespace inceres::internal {

/// The active set of an incremental step (docs/algorithms.md, "Lazy steps"): which frames and
/// landmarks move, and what that leaves undone.
///
/// Few frames move, and take the step that is best while all others stay (PartialStep), if that
/// gains the whole step's gain but for the budget. Where it takes too many the step is cut off
/// instead: in the reduced quadratic, with every landmark that sees a moved frame substituted back,
/// leaving the frames D where they are then costs exactly ½ δ_Dᵀ S' δ_D. So the frames are taken in
/// the order of their own gains δ_iᵀ S'_ii δ_i, and the longest leading part that costs no more
/// than the budget stays put. Landmarks that see no moved frame are visited if they could gain a
/// share of the budget by themselves.
class ActiveSet {
 public:
  explicit ActiveSet(const Tuning::Truncate& limits) : partial_step_(limits) {}

  struct Limits {
    // what may be left undone; negative: nothing, all of the step is taken
    double remaining_decrease;
    double negligible;  // a row that was not solved anew stays if δ_iᵀ diag(C)_i δ_i is no more
    double frame_gain;  // ½ bᵀδ
  };
  /// Sets the steps of the active variables in the system. `frame_step` solves S' δ = b, S' = S +
  /// diag(damping), packed; what rows that were not solved anew have of it is what was left of
  /// their step before.
  void Select(const std::vector<double>& frame_step, const ReducedVectors& reduced,
              const ReducedSolver::Rows& solved, const Limits& limits, IncrementalSystem* system);

  void Clear() {
    frames_.clear();
    landmarks_.clear();
  }
  /// Whether all of the step was asked for.
  bool is_whole() const { return is_whole_; }
  const std::vector<std::int32_t>& frames() const { return frames_; }
  const std::vector<std::int32_t>& landmarks() const { return landmarks_; }
  std::size_t Bytes() const { return partial_step_.Bytes(); }

 private:
  void NameCandidates(const std::vector<double>& frame_step, const ReducedVectors& reduced,
                      const ReducedSolver::Rows& solved, double negligible,
                      const IncrementalSchur& schur);
  void CutOff(const std::vector<double>& frame_step, const std::vector<double>& damping,
              double budget, IncrementalSystem* system);
  void RankFrames(const std::vector<double>& frame_step, const std::vector<double>& damping,
                  const IncrementalSchur& schur);
  double CostOfLeaving(std::int32_t at, const std::vector<double>& frame_step,
                       const IncrementalSchur& schur);

  enum class Fate : std::uint8_t { kMoves, kIsAsked, kIsLeft };

  bool is_whole_ = true;
  std::vector<std::int32_t> candidates_;  // the rows that may move, ascending
  std::vector<double> gains_;             // per candidate
  std::vector<std::int32_t> order_;       // candidates by gain
  std::vector<Fate> fates_;               // per row of S, while it is decided
  std::vector<double> cross_;             // per row of S, and of its blocks with frames left so far
  PartialStep partial_step_;
  std::vector<std::int32_t> frames_;
  IndexSet listed_;  // landmarks of the list, while it is made
  std::vector<std::int32_t> landmarks_;
};

}  // namespace inceres::internal
