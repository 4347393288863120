#include "linear/tip_marginal.h"

#include <algorithm>
#include <limits>

#include <Eigen/LU>

#include "linear/small_cholesky.h"

namespace inceres::internal {

// A marginal that goes along with the newest row (docs/algorithms.md, "From a live factor"): a pose
// of odometry costs a few products of 3 × 3 or 6 × 6 blocks, however large the problem. What is
// carried on is never further from S⁻¹ than rounding of S itself is: a difference K below that
// counts as zero, a Σ' far from Σ is given up.
//
// Products are written as lazy ones and solves row by row: of blocks this small a call of a general
// product takes longer than the product itself. All that is remembered of S is what row p had, its
// diagonal block, its neighbors and their blocks, and how many blocks S had lost: anything else
// that changes at p is seen by comparing.

namespace {

using Block = TipMarginal::Block;

// K in units of √(S_ii S_jj): sums that S is made of are rounded by this much.
constexpr double kRounding = 16.0 * std::numeric_limits<double>::epsilon();
// Of a variance by a change: four of sixteen digits are gone.
constexpr double kLeastVarianceLeft = 1e-4;

// Blocks whose sizes are constants, or are not known before they are looked at.
template <int kRows, int kColumns>
using Sized = Eigen::Matrix<double, kRows, kColumns, Eigen::RowMajor,
                            kRows == Eigen::Dynamic ? TipMarginal::kMostScalars : kRows,
                            kColumns == Eigen::Dynamic ? 2 * TipMarginal::kMostScalars : kColumns>;

template <typename Square>
void ReadDiagonal(const SymmetricBlockRows& S, int row, Square* block) {
  const int size = S.size_of(row), stride = PadToQuad(size);
  const double* values = S.values(S.row(row).back().offset);
  block->resize(size, size);
  for (int i = 0; i < block->rows(); ++i) {
    // The lower triangle counts.
    for (int j = 0; j <= i; ++j) {
      (*block)(i, j) = (*block)(j, i) = values[i * stride + j];
    }
  }
}

// S_np, whichever of the two has it among its own.
template <typename Columns>
void ReadCoupling(const SymmetricBlockRows& S, int n, int p, Columns* block) {
  const int row = std::max(p, n), column = std::min(p, n);
  const double* values = S.values(S.Find(row, column));
  const int stride = PadToQuad(S.size_of(column));
  for (int i = 0; i < block->rows(); ++i) {
    for (int j = 0; j < block->cols(); ++j) {
      (*block)(i, j) = n == row ? values[i * stride + j] : values[j * stride + i];
    }
  }
}

// X := L⁻¹ X, and X := L⁻ᵀ X, of the factor that FactorSmall leaves.
template <typename Square, typename Columns>
// All columns of X at once, row by row of L. The diagonal is not read, only its reciprocals, which
// FactorSmall has kept.
void SolveForward(const Square& L, const double* inverse_pivots, Columns* X) {
  for (int i = 0; i < L.rows(); ++i) {
    for (int k = 0; k < i; ++k) {
      X->row(i) -= L(i, k) * X->row(k);
    }
    X->row(i) *= inverse_pivots[i];
  }
}
template <typename Square, typename Columns>
void SolveBackward(const Square& L, const double* inverse_pivots, Columns* X) {
  for (int i = static_cast<int>(L.rows()) - 1; i >= 0; --i) {
    for (int k = i + 1; k < L.rows(); ++k) {
      X->row(i) -= L(k, i) * X->row(k);
    }
    X->row(i) *= inverse_pivots[i];
  }
}

// Whether the row has no block but its own and one with p.
bool IsCoupledTo(const SymmetricBlockRows& S, int row, int p) {
  return S.Degree(row) == 1 && S.Find(std::max(row, p), std::min(row, p)) >= 0;
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
  ReadDiagonal(S, row_, &diagonal_);
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

// Σ' = Σ − Σ (I + K Σ)⁻¹ K Σ. K Σ is neither symmetric nor small where a row becomes much better
// known, so I + K Σ is solved with pivots. The difference is exact as long as it is not much
// smaller than what it is a difference of: variances must neither fall nor rise by more than 10⁴.
// On false Σ is of no use, and the caller gives it up.
bool TipMarginal::AddToTip(const Block& K) {
  Block I_KS = K.lazyProduct(sigma_);
  const Block K_sigma = I_KS;
  I_KS.diagonal().array() += 1.0;
  const Block change = sigma_.lazyProduct(I_KS.partialPivLu().solve(K_sigma).eval());
  const Block left = sigma_ - change, before = sigma_;
  // Digits go where information comes and where it goes. Also false of a NaN.
  const auto v = left.diagonal().array(), v_before = before.diagonal().array();
  const bool is_exact =
      (v >= kLeastVarianceLeft * v_before).all() && (v_before >= kLeastVarianceLeft * v).all();
  sigma_ = 0.5 * (left + left.transpose());
  return is_exact;
}

// Planar and spatial poses have loops of constant lengths.
bool TipMarginal::Advance(const SymmetricBlockRows& S, int n) {
  const int size = S.size_of(n);
  if (size == 0 || size > kMostScalars || S.num_released() != num_released_ ||
      !IsCoupledTo(S, n, row_) || !HasGainedOnly(S, n)) {
    return false;
  }
  const bool are_alike = size == S.size_of(row_);
  const bool is_known = are_alike && size == 3   ? CarryOn<3>(S, n)
                        : are_alike && size == 6 ? CarryOn<6>(S, n)
                                                 : CarryOn<Eigen::Dynamic>(S, n);
  if (is_known) {
    row_ = n;
    Remember(S);
  }
  return is_known;
}

template <int kSize>
// With C = L Lᵀ and X = L⁻¹Bᵀ, B C⁻¹ Bᵀ is XᵀX: symmetric by construction, and taken before X
// becomes M. Two solves, forwards and backwards, give M and C⁻¹ side by side. Where K is rounding,
// as along the odometry, Σ' = Σ to the bit, and nothing gathers over thousands of poses.
bool TipMarginal::CarryOn(const SymmetricBlockRows& S, int n) {
  using Square = Sized<kSize, kSize>;
  using Columns = Sized<kSize, kSize == Eigen::Dynamic ? kSize : 2 * kSize>;
  const int size = S.size_of(n), tip_size = S.size_of(row_);
  Square C, now;
  ReadDiagonal(S, n, &C);
  ReadDiagonal(S, row_, &now);
  double inverse_pivots[kMostScalars];
  if (!FactorSmall(size, C.data(), size, inverse_pivots)) {
    return false;
  }
  // L⁻¹ [Bᵀ I] at first, then C⁻¹ [Bᵀ I] = [M C⁻¹].
  Columns X(size, tip_size + size);
  auto M = X.template leftCols<kSize>(tip_size);
  auto C_inv = X.template rightCols<kSize>(size);
  ReadCoupling(S, n, row_, &M);
  C_inv.setIdentity();
  SolveForward(C, inverse_pivots, &X);
  const Square K = now - diagonal_ - M.transpose().lazyProduct(M);
  SolveBackward(C, inverse_pivots, &X);
  // Also of a NaN: no rounding.
  const auto scale = now.diagonal().cwiseAbs().cwiseSqrt().eval();
  const bool is_rounding =
      (K.array().abs() <= kRounding * (scale * scale.transpose()).array()).all();
  if (!is_rounding && !AddToTip(K)) {
    return false;
  }
  const Square tip = sigma_;
  const Square M_tip = M.lazyProduct(tip);
  const Square sigma = M_tip.lazyProduct(M.transpose()) + C_inv;
  sigma_ = 0.5 * (sigma + sigma.transpose());
  return true;
}

// Two rows, one of them p: that is a pose that has come along the odometry. Whatever else has
// changed, a loop or a landmark, is beyond it.
void TipMarginal::Follow(const SymmetricBlockRows& S, const std::vector<std::int32_t>& changed) {
  const bool is_pair = changed.size() == 2 && (changed[0] == row_ || changed[1] == row_);
  if (row_ != kNone && !(is_pair && Advance(S, changed[0] == row_ ? changed[1] : changed[0]))) {
    Forget();
  }
}

}  // namespace inceres::internal
