#pragma once

#include <cstddef>
#include <cstdint>

#include "base/aligned_vector.h"
#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"

namespace inceres::internal {

/// Σ ‖λDδ‖² of the blocks that move, D² = diag H and λ their damping: of frames and of landmarks
/// that are damped by no more; and of landmarks that are, or would be if eliminated anew.
struct DampedSquares {
  double like_frames = 0.0;
  double more = 0.0;
};

/// The variables that a step moves, and the step, padded, of all variables: zero where nothing
/// moves.
class ActiveVariables {
 public:
  explicit ActiveVariables(const IncrementalSchur& schur) : schur_(schur) {}

  /// Makes room for the variables that have come, which take so many quads.
  void Grow(std::int32_t num_quads);

  IndexSet& frames() { return frames_; }
  const IndexSet& frames() const { return frames_; }
  IndexSet& landmarks() { return landmarks_; }
  const IndexSet& landmarks() const { return landmarks_; }
  bool empty() const { return frames_.empty() && landmarks_.empty(); }

  /// The step of the variable with this place, and of all.
  double* step(std::int32_t quad) { return step_.data() + std::ptrdiff_t{quad} * kQuad; }
  const double* step(std::int32_t quad) const {
    return step_.data() + std::ptrdiff_t{quad} * kQuad;
  }
  AlignedVector<double>& step() { return step_; }
  const AlignedVector<double>& step() const { return step_; }

  /// Calls visit(frame or landmark as the system has it) of each that moves, frames first.
  template <typename Visit>
  void ForEach(Visit&& visit) const {
    frames_.ForEach([&](std::int32_t i) { visit(schur_.frames()[i]); });
    landmarks_.ForEach([&](std::int32_t l) { visit(schur_.landmarks()[l]); });
  }
  /// Calls visit(first entry in padded vectors, size, function from coordinate to diag H) of each.
  template <typename Visit>
  void ForEachBlock(Visit&& visit) const {
    frames_.ForEach([&](std::int32_t i) {
      const double* C = schur_.FrameDiagonal(i);
      visit(std::ptrdiff_t{schur_.frames()[i].quad} * kQuad, schur_.frames()[i].size,
            [C](int k) { return C[k]; });
    });
    landmarks_.ForEach([&](std::int32_t l) {
      const IncrementalSchur::Landmark& landmark = schur_.landmarks()[l];
      const double* P = schur_.blocks().P(l);
      visit(std::ptrdiff_t{landmark.quad} * kQuad, landmark.size,
            [P](int k) { return P[k * kQuad + k]; });
    });
  }

  /// ‖Dδ‖, D² = diag H; and ‖δ‖.
  double ScaledNorm() const;
  double Norm() const;
  /// What damping takes part with, if that of the frames is μ, and that of landmarks which are
  /// eliminated now λ.
  DampedSquares FindDampedSquares(double mu, double lambda) const;
  /// The landmark's step becomes t times itself.
  void Stretch(std::int32_t landmark, double t);
  /// The landmark stays where it is after all.
  void LeaveOut(std::int32_t landmark);
  /// Nothing moves.
  void Clear();

 private:
  const IncrementalSchur& schur_;
  IndexSet frames_;
  IndexSet landmarks_;
  AlignedVector<double> step_;
};

}  // namespace inceres::internal
