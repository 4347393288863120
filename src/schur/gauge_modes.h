#pragma once

#include <cstdint>
#include <vector>

#include "inceres/linear/reduced_matrix.h"
#include "linear/sparse_cholesky.h"
#include "linearize/incidences.h"

namespace inceres::internal {

/// How the frames move when the Euclidean landmarks move as one: three translations, three
/// rotations, one change of scale. What a frame's parameters mean nobody knows here: its modes v
/// are the least-squares solution of J_c v = −J_l w over all factors of such landmarks, w the
/// motion of the landmark, shared frames held. Then ‖J_c v + J_l w‖² is what the factors feel of
/// the motion: nothing, where they measure relative to the frames.
///
/// A landmark is Euclidean if it is three numbers without a manifold. A mode that the frames do not
/// follow (the scale, where a stereo rig knows it; all, where three numbers are an inverse depth
/// and a direction) is left out. Cost of Compute: a pass over J, and a block of J_cᵀJ_c a frame to
/// factor. Threads: the evaluator's; the same bits for any number.
class GaugeModes {
 public:
  static constexpr int kCount = 7;
  static constexpr int kStride = 8;

  /// Reads connections only. Fails as the analysis of J_cᵀJ_c.
  GaugeModes(const Evaluator& evaluator, const std::vector<char>& is_shared, Status* status);

  /// Whether most factors of landmarks have a Euclidean one; if not, Compute finds nothing.
  bool AreEuclidean() const { return are_euclidean_; }

  /// Modes where the evaluator's Jacobians are. False if they are of no use: J_cᵀJ_c has no factor,
  /// or fewer than six fit.
  bool Compute();

  /// The modes of a frame, a column each, from row to row kStride; those left out are zero.
  const double* Of(int frame) const { return V_.data() + Begin(frame); }
  /// ‖J_c v + J_l w‖² / ‖J_l w‖² of each mode, in the last Compute.
  const double* misfit() const { return misfit_; }
  std::int64_t Bytes() const;

 private:
  // Factors of one family that touch frames through one slot and a Euclidean landmark through
  // another, by frame.
  struct Source {
    int family;
    int slot;
    int landmark_slot;
    std::vector<int> begin;  // per frame, one more
    std::vector<std::int32_t> factors;
  };

  void CollectSources();
  void AddSource(const Linearization& cache, int slot, int landmark_slot,
                 const std::vector<std::int32_t>& factors);
  void BuildPattern();
  void FindCenter();
  void Accumulate(int begin, int end);
  void AddFactor(const Source& source, int factor, int frame, double* R, double* squares);
  void AddBlocks(const Source& source, int factor, int frame);
  bool Factorize();
  bool SolveModes();
  std::int64_t Begin(int frame) const {
    return std::int64_t{kStride} * pattern_.offsets[static_cast<std::size_t>(frame)];
  }
  int FrameThrough(const Linearization& cache, int factor, int slot) const;
  int LandmarkThrough(const Linearization& cache, int factor, int slot) const;

  const Evaluator& evaluator_;
  const std::vector<char> is_shared_;
  bool are_euclidean_ = false;
  std::vector<Source> sources_;
  BlockPattern pattern_;  // of J_cᵀJ_c, by frames
  SparseCholesky factor_;
  std::vector<double> C_;
  std::vector<double> diagonal_;
  std::vector<double> R_;        // −J_cᵀ J_l w, as V_
  std::vector<double> V_;        // packed rows, kStride apart
  std::vector<double> squares_;  // per frame: Σ ‖J_l w‖² of the factors that count there
  double center_[3] = {};
  double inverse_radius_ = 1.0;
  double misfit_[kCount] = {};
};

}  // namespace inceres::internal
