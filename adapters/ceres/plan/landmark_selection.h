#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "adapters/ceres/read/factor_shapes.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "src/base/available_memory.h"

namespace inceres::internal {

/// Largest tangent size of a landmark.
inline constexpr int kMaxLandmarkSize = 4;

struct LandmarkCounts {
  int num_landmarks = 0;
  /// blocks of the user's first group that stay frames because their tangent size exceeds the
  /// largest
  int num_too_large = 0;
  /// blocks that were to be landmarks and stay frames because S would become too full
  /// (KeepLongTracks)
  int num_kept = 0;
};

/// Which blocks are eliminated before the reduced system is formed: at most one in any residual
/// block.
struct LandmarkSelection : LandmarkCounts {
  LandmarkSelection() = default;
  /// Chooses none of so many blocks.
  explicit LandmarkSelection(std::size_t num_blocks) : is_landmark(num_blocks, 0) {}

  std::vector<char> is_landmark;  ///< per parameter block
  /// Of ITERATIVE_SCHUR, where some are too large for landmarks: the blocks that are eliminated,
  /// none of which is a landmark. Else empty.
  std::vector<int> large;
  /// The other variable blocks in Ceres's order, where that matters (OrderingView::numbers_frames).
  std::vector<int> frames_in_order;
  std::string obstacle;  ///< why no choice can be solved with: too little memory; empty if one can

  bool Contains(int block) const { return is_landmark[static_cast<std::size_t>(block)] != 0; }
};

/// Takes the landmarks the user asked for: the blocks of the ordering's first group, as far as they
/// are small enough; what Ceres would eliminate without a limit. The group is an independent set
/// (the gate has checked).
LandmarkSelection LandmarksOfFirstGroup(const ProblemView& view, const OrderingView& ordering,
                                        int max_size = kMaxLandmarkSize);

/// Chooses landmarks by predicted cost.
///
/// Candidates are variable blocks of tangent size e ≤ 4 that touch less than a fifth of all
/// residual blocks (with ten residual blocks or more). They are sorted into *kinds*: two blocks are
/// of one kind if both ever stand in the same slot of residual blocks of one shape. A block that
/// shares a residual block with another of its own kind is no landmark: so the poses of a pose
/// graph, whole or split into rotation and translation, stay frames whatever their size, and so do
/// neighbors on a chain. What is left of a kind is independent, and kinds are taken in order of
/// their cost per eliminated unknown, as far as no earlier kind stands in the way.
///
/// A kind is taken if that is predicted to be cheaper than leaving it in. With D the summed tangent
/// size of the frames that a landmark meets, N the unknowns left, E those of the kind, in
/// multiplications:
///
///     eliminate:  Σ (e D² + o)                one small block each, o = 100 for handling it
///     keep:       min( (N³ − (N − E)³) / 3,   in a dense Cholesky factorization
///                      Σ (4 e (D + e)² + o) ) in a sparse one, which does the same less
///                                             regularly
///
/// Cost: linear in slots, most of it shared among threads; the choice is the same with any number
/// of them.
LandmarkSelection ChooseLandmarks(const ProblemView& view, const ShapeTable& shapes,
                                  int num_threads = 1);

/// Takes back those landmarks of a selection whose elimination costs more than it saves, because it
/// couples all the frames of a landmark to each other: a few points seen by hundreds of cameras
/// make S full, while next to the cameras they leave it nearly empty, and its sparse factorization
/// then eliminates the cameras first, in effect.
///
/// What may stay is as little as the frames are: all landmarks, or those that meet at least 1/2,
/// 1/4 or 1/8 of the unknowns of the frames, as long as they have no more unknowns together than
/// these. For each such choice elimination and factorization are predicted, the latter by the
/// symbolic analysis of the block pattern; the cheapest is taken, the selection itself unless it
/// takes a fifth more. Where memory is short, so is the cheapest of those that fit; where none
/// does, `obstacle` says so.
///
/// Cost: nothing for S of up to 300 unknowns, linear where S is cheap to factor for another reason,
/// else the pairs of frames that landmarks bring and half a microsecond a block of S: less than one
/// step of the solver that is spared.
void KeepLongTracks(const ProblemView& view, const AvailableMemory& available,
                    LandmarkSelection* selection);

/// Which of the two, or neither for a QR factorization, goes with a linear solver (the effective
/// one); without the landmarks that KeepLongTracks takes back from either. What the user asked for
/// is a hint, too: the solution is the same up to rounding.
LandmarkSelection SelectLandmarks(const ProblemView& view, const OrderingView& ordering,
                                  const ShapeTable& shapes, ceres::LinearSolverType type,
                                  const AvailableMemory& available = nullptr, int num_threads = 1);

/// All that is eliminated, of whatever size.
LandmarkSelection WithLarge(const LandmarkSelection& landmarks);

/// Whether the user has said which blocks to eliminate.
inline bool LandmarksAreGiven(const OrderingView& ordering, ceres::LinearSolverType type) {
  return IsSchurType(type) && ordering.group_sizes.size() > 1;
}

}  // namespace inceres::internal
