#pragma once

#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "linear/block_rows.h"

namespace inceres::internal {

/// The marginal Σ = (S⁻¹)_pp of the row p at which a problem grows, carried along as rows come: a
/// new row n that is coupled to p alone needs nothing but Σ. With what S has gained since Σ was
/// known, Δ at p, B between p and n, C at n,
///
///     K = Δ − B C⁻¹ Bᵀ,    Σ' = Σ − Σ (I + K Σ)⁻¹ K Σ,    M = C⁻¹ Bᵀ,    Σ_n = C⁻¹ + M Σ' Mᵀ,
///
/// and n is the next p. Along the odometry K is zero but for rounding: a pose that nothing but its
/// predecessor knows tells nothing of that.
/// Cost: a few products of blocks. Source: Woodbury's identity, Golub & Van Loan, "Matrix
/// Computations", section 2.1.4, with n eliminated.
class TipMarginal {
 public:
  /// Rows of more scalars are not followed.
  static constexpr int kMostScalars = 15;
  using Block = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostScalars,
                              kMostScalars>;

  /// Σ of the row at this S, by other means.
  void Set(const SymmetricBlockRows& S, int row, const Eigen::MatrixXd& sigma);
  /// `changed`, ascending and not empty, are all rows of S that have changed since the last call or
  /// Set. From then on nothing is known unless these are p and a new row coupled to p alone.
  void Follow(const SymmetricBlockRows& S, const std::vector<std::int32_t>& changed);
  /// Nothing is known from now on.
  void Forget() { row_ = kNone; }

  bool Knows(int row) const { return row_ == row && row_ != kNone; }
  const Block& sigma() const { return sigma_; }

 private:
  static constexpr int kNone = -1;

  bool Advance(const SymmetricBlockRows& S, int n);
  template <int kSize>
  bool CarryOn(const SymmetricBlockRows& S, int n);
  void Remember(const SymmetricBlockRows& S);
  template <typename Visit>
  void ForEachNeighbor(const SymmetricBlockRows& S, int row, const Visit& visit) const;
  bool HasGainedOnly(const SymmetricBlockRows& S, int n) const;
  bool AddToTip(const Block& K);

  int row_ = kNone;
  Block sigma_;
  Block diagonal_;                  // of S at p, symmetric, when Σ was of now
  std::vector<int> neighbors_;      // of p then
  std::vector<double> couplings_;   // their blocks with p, one after the other
  std::int64_t num_released_ = -1;  // blocks of S
};

}  // namespace inceres::internal
