#pragma once

#include <cstdint>
#include <vector>

#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"
#include "incremental/reduced_vectors.h"
#include "incremental/tuning.h"
#include "linear/envelope_cholesky.h"
#include "linear/row_order.h"

namespace inceres::internal {

/// The step of a few frames A while all others, D, stay:
///
///     S'_AA x_A = b_A,   which gains ½ b_Aᵀ x_A in the reduced quadratic.
///
/// With δ the step of all frames, that falls short of the whole gain by ½ δ_Dᵀ (S'_DD − S'_DA
/// S'_AA⁻¹ S'_AD) δ_D: the frames of A make up for those that stay. So a part of the graph that
/// would only be carried along as one piece, as what lies behind a weak link is, costs next to
/// nothing to leave, where cutting δ itself off there would tear it from its neighbors.
class PartialStep {
 public:
  explicit PartialStep(const Tuning::Truncate& limits) : limits_(limits) {}

  /// Whether S is larger than A may become: of a small window nearly all moves.
  bool IsWorthwhile(const IncrementalSchur& schur) const;

  /// Grows A, from the frames that b pulls at most, until its step gains this much; in each round
  /// by those at which what is left of b then pulls most. False if that takes too many frames, or
  /// S'_AA = S_AA + diag(damping) has no factor. Cost: that of a small Cholesky factor and of the
  /// blocks of A's rows, and a pass over the pulls; no allocation beyond the growth of what it
  /// keeps.
  bool Find(const IncrementalSchur& schur, const ReducedVectors& reduced, double gain);

  bool HasRoomFor(const IncrementalSchur& schur, const IndexSet& frames) const;
  /// A as given; there is room for it. False if there is no factor.
  bool Solve(const IncrementalSchur& schur, const ReducedVectors& reduced, const IndexSet& frames);

  int num_frames() const { return order_.num_places(); }
  std::int32_t frame(int k) const { return order_.row(k); }
  const double* step(int k) const { return x_.data() + cholesky_.offsets()[k]; }
  std::size_t Bytes() const;

 private:
  void MakeRoom(const IncrementalSchur& schur);
  void Append(const IncrementalSchur& schur, const ReducedVectors& reduced, std::int32_t frame);
  void Begin(const IncrementalSchur& schur, const ReducedVectors& reduced);
  void BeginRest(const IncrementalSchur& schur, const ReducedVectors& reduced, std::int32_t frame);
  void Grow(const IncrementalSchur& schur, const ReducedVectors& reduced);
  void BackSubstitute();
  void TakeOutOfRest(const IncrementalSchur& schur, const ReducedVectors& reduced);

  const Tuning::Truncate limits_;
  int size_with_room_ = -1;  // of S
  RowOrder order_;           // A, as it has grown
  EnvelopeCholesky cholesky_;
  IndexSet pulled_;            // rows outside A with a pull to speak of, among others
  std::vector<double> rest_;   // of those: b − S'x, packed like S
  std::vector<double> pulls_;  // of those: at the rest
  // Packed like A:
  std::vector<double> b_;
  std::vector<double> damping_;
  std::vector<double> y_;
  std::vector<double> remainder_;
  std::vector<double> x_;
};

}  // namespace inceres::internal
