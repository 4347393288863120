#pragma once

#include <cstdint>
#include <vector>

#include "inceres/linear/reduced_solver.h"
#include "linear/coarse_columns.h"
#include "linear/sparse_cholesky.h"
#include "schur/frame_aggregates.h"
#include "schur/gauge_normals.h"

namespace inceres::internal {

/// Solves the normal equations of the modes of frames.
class GaugeFit {
 public:
  /// `pattern`: of J_cᵀJ_c. Fails as its analysis.
  GaugeFit(BlockPattern pattern, const Executor& executor, Status* status);

  /// False if the modes are of no use: J_cᵀJ_c has no factor, or fewer than six fit.
  bool Solve(const GaugeSums& sums);
  /// The modes of a frame, a column each, from row to row kGaugeStride; those left out are zero.
  const double* Of(int frame) const {
    return V_.data() + std::int64_t{kGaugeStride} * pattern_.offsets[frame];
  }
  /// ‖J_c v + J_l w‖² / ‖J_l w‖² of each mode, in the last Solve.
  const double* misfit() const { return misfit_; }
  std::int64_t Bytes() const;

 private:
  bool Factorize(const std::vector<double>& C);
  bool SolveModes(const GaugeSums& sums);

  const BlockPattern pattern_;
  SparseCholesky factor_;
  std::vector<double> diagonal_;
  std::vector<double> V_;  // packed rows
  double misfit_[kGaugeModes] = {};
};

/// How the frames move when the Euclidean landmarks move as one: three translations, three
/// rotations, one change of scale. What a frame's parameters mean nobody knows here: its modes v
/// are the least-squares solution of J_c v = −J_l w over all factors of such landmarks, w the
/// motion of the landmark, shared frames held. Then ‖J_c v + J_l w‖² is what the factors feel of
/// the motion: nothing, where they measure relative to the frames.
///
/// A mode that the frames do not follow (the scale, where a stereo rig knows it; all, where three
/// numbers are an inverse depth and a direction) is left out. Cost of Compute: a pass over J, and a
/// block of J_cᵀJ_c a frame to factor. Threads: the evaluator's; the same bits for any number.
class GaugeModes {
 public:
  /// Reads connections only. Fails as the analysis of J_cᵀJ_c.
  GaugeModes(const Evaluator& evaluator, const std::vector<char>& is_shared, Status* status);

  /// Whether most factors of landmarks have a Euclidean one; if not, Compute finds nothing.
  bool AreEuclidean() const { return are_euclidean_; }
  /// Modes where the evaluator's Jacobians are. False as of GaugeFit::Solve.
  bool Compute();

  const GaugeFit& fit() const { return fit_; }
  std::int64_t Bytes() const { return normals_.Bytes() + sums_.Bytes() + fit_.Bytes(); }

 private:
  GaugeNormals normals_;
  bool are_euclidean_;
  GaugeSums sums_;
  GaugeFit fit_;
};

/// Which columns of V each aggregate of frames has. By gauge: the seven gauge modes; else, or where
/// they do not fit, one for each parameter of a frame (of the first seven), which frames of the
/// same size share. A shared frame has all of its parameters.
class ModeColumns {
 public:
  /// `offsets`: first scalar of each frame, and the total.
  ModeColumns(const FrameAggregates& aggregates, const std::vector<int>& offsets, bool by_gauge);

  /// Per aggregate.
  const std::vector<int>& widths() const { return widths_; }
  /// V of the columns; null: the modes do not fit.
  void Write(const GaugeFit* modes, CoarseColumns* columns) const;

 private:
  const std::vector<char> is_shared_;
  std::vector<int> widths_;
  std::vector<int> constant_column_;  // per frame: the first of its own, without gauge modes
};

}  // namespace inceres::internal
