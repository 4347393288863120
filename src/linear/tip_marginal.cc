#include "linear/tip_marginal.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>
#include <Eigen/LU>

namespace inceres::internal {

// A marginal that goes along with the newest row (docs/algorithms.md, "From a live factor"): a pose
// of odometry costs a few products of 3 × 3 or 6 × 6 blocks, however large the problem. What is
// carried on is never further from S⁻¹ than rounding of S itself is: a difference K below that
// counts as zero, a Σ' far from Σ is given up.

namespace {

using Block = TipMarginal::Block;

// K in units of √(S_ii S_jj): sums that S is made of are rounded by this much.
constexpr double kRounding = 16.0 * std::numeric_limits<double>::epsilon();
// Of a variance by a change: four of sixteen digits are gone.
constexpr double kLeastLeft = 1e-4;

Block DiagonalOf(const SymmetricBlockRows& S, int row) {
  const int size = S.size_of(row), stride = PadToQuad(size);
  const double* values = S.values(S.row(row).back().offset);
  Block block(size, size);
  for (int i = 0; i < size; ++i) {
    // The lower triangle counts.
    for (int j = 0; j <= i; ++j) {
      block(i, j) = block(j, i) = values[i * stride + j];
    }
  }
  return block;
}

// S_pn, whichever of the two has it among its own.
Block CouplingOf(const SymmetricBlockRows& S, int p, int n) {
  const int row = std::max(p, n), column = std::min(p, n);
  const double* values = S.values(S.Find(row, column));
  const int stride = PadToQuad(S.size_of(column));
  Block block(S.size_of(p), S.size_of(n));
  for (int i = 0; i < block.rows(); ++i) {
    for (int j = 0; j < block.cols(); ++j) {
      block(i, j) = p == row ? values[i * stride + j] : values[j * stride + i];
    }
  }
  return block;
}

// Whether the row has no block but its own and one with p.
bool IsCoupledTo(const SymmetricBlockRows& S, int row, int p) {
  const std::size_t num_blocks = S.row(row).size() - 1 + S.below(row).size();
  return num_blocks == 1 && S.Find(std::max(row, p), std::min(row, p)) >= 0;
}

}  // namespace

// Blocks with p but its own: the row's, then those below it.
template <typename Visit>
void TipMarginal::ForEachNeighbor(const SymmetricBlockRows& S, int row, const Visit& visit) const {
  for (const SymmetricBlockRows::Entry& entry : S.row(row)) {
    if (entry.column != row) {
      visit(entry.column, S.values(entry.offset),
            S.size_of(row) * PadToQuad(S.size_of(entry.column)));
    }
  }
  for (const int below : S.below(row)) {
    visit(below, S.values(S.Find(below, row)), S.size_of(below) * PadToQuad(S.size_of(row)));
  }
}

void TipMarginal::Remember(const SymmetricBlockRows& S) {
  diagonal_ = DiagonalOf(S, row_);
  num_released_ = S.num_released();
  neighbors_.clear();
  couplings_.clear();
  ForEachNeighbor(S, row_, [this](int neighbor, const double* values, int length) {
    neighbors_.push_back(neighbor);
    couplings_.insert(couplings_.end(), values, values + length);
  });
}

void TipMarginal::Set(const SymmetricBlockRows& S, int row, const Eigen::MatrixXd& sigma) {
  row_ = kNone;
  if (S.size_of(row) <= kMostScalars && sigma.rows() == S.size_of(row)) {
    row_ = row;
    sigma_ = sigma;
    Remember(S);
  }
}

// Whether p has the blocks that it had, and one with n besides, which it did not have.
// A block may also have been summed anew without its row and its column being told of.
bool TipMarginal::HasGainedOnly(const SymmetricBlockRows& S, int n) const {
  std::size_t known = 0, begin = 0;
  int num_new = 0;
  bool is_as_before = true;
  ForEachNeighbor(S, row_, [&](int neighbor, const double* values, int length) {
    if (neighbor == n) {
      ++num_new;
      return;
    }
    is_as_before = is_as_before && known < neighbors_.size() && neighbors_[known] == neighbor &&
                   std::equal(values, values + length, couplings_.begin() + begin);
    ++known;
    begin += length;
  });
  return is_as_before && num_new == 1 && known == neighbors_.size();
}

// Σ' = Σ − Σ (I + K Σ)⁻¹ K Σ.
bool TipMarginal::AddToTip(const Block& K) {
  Block I_KS = K.lazyProduct(sigma_);
  const Block K_sigma = I_KS;
  I_KS.diagonal().array() += 1.0;
  const Block change = sigma_.lazyProduct(I_KS.partialPivLu().solve(K_sigma).eval());
  const Block left = sigma_ - change, before = sigma_;
  // Digits go where information comes and where it goes. Also false of a NaN.
  const auto v = left.diagonal().array(), v_before = before.diagonal().array();
  const bool is_exact = (v >= kLeastLeft * v_before).all() && (v_before >= kLeastLeft * v).all();
  sigma_ = 0.5 * (left + left.transpose());
  return is_exact;
}

bool TipMarginal::Advance(const SymmetricBlockRows& S, int n) {
  const int size = S.size_of(n);
  if (size == 0 || size > kMostScalars || S.num_released() != num_released_ ||
      !IsCoupledTo(S, n, row_) || !HasGainedOnly(S, n)) {
    return false;
  }
  const Block B = CouplingOf(S, row_, n), now = DiagonalOf(S, row_);
  const Eigen::LLT<Block> C(DiagonalOf(S, n));
  if (C.info() != Eigen::Success) {
    return false;
  }
  const Block M = C.solve(B.transpose());
  const Block K = now - diagonal_ - B.lazyProduct(M);
  // Also of a NaN: no rounding.
  const auto scale = now.diagonal().cwiseAbs().cwiseSqrt().eval();
  const bool is_rounding =
      (K.array().abs() <= kRounding * (scale * scale.transpose()).array()).all();
  if (!is_rounding && !AddToTip(K)) {
    return false;
  }
  sigma_ = M.lazyProduct(sigma_).eval().lazyProduct(M.transpose()).eval();
  sigma_ += C.solve(Block::Identity(size, size));
  sigma_ = (0.5 * (sigma_ + sigma_.transpose())).eval();
  row_ = n;
  Remember(S);
  return true;
}

void TipMarginal::Follow(const SymmetricBlockRows& S, const std::vector<std::int32_t>& changed) {
  const bool is_pair = changed.size() == 2 && (changed[0] == row_ || changed[1] == row_);
  if (row_ != kNone && !(is_pair && Advance(S, changed[0] == row_ ? changed[1] : changed[0]))) {
    Forget();
  }
}

}  // namespace inceres::internal
