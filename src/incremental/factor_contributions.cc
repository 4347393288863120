#include "incremental/factor_contributions.h"

#include <algorithm>
#include <utility>

namespace inceres::internal {

// The part of S and b that comes of frames alone, Σ J_cᵀJ_c and −Σ J_cᵀq, factor by factor
// (docs/algorithms.md, "Incremental Schur complement"). A factor whose Jacobians change has its old
// rows copied first: both, −A_outᵀA_out + AᵀA, then go through a block of S at once, which reads
// and writes it once instead of twice, and cancels where little has changed before it is added.

void FactorContributions::Connect(FactorRef ref) {
  const IncrementalFamily& family = families_[ref.family];
  const std::size_t num_pairs =
      static_cast<std::size_t>(family.num_slots()) * (family.num_slots() + 1) / 2;
  blocks_.resize(families_.size());
  std::vector<std::int32_t>& blocks = blocks_[ref.family];
  if (blocks.size() < family.num_places() * num_pairs) {
    blocks.resize(family.num_places() * num_pairs, -1);
  }
  blocks[ref.factor * num_pairs] = -1;
}

// The frames of a factor with their Jacobians, ascending, into rows_ and rows_of_.
Contribution FactorContributions::RowsOf(FactorRef ref) {
  const IncrementalFamily& family = families_[ref.family];
  rows_.clear();
  rows_of_.clear();
  for (int s = 0; s < family.num_slots(); ++s) {
    const std::int32_t row = structure_.FrameOfFactor(ref, s);
    if (row < 0) {
      continue;
    }
    const IncrementalStructure::Frame& frame = structure_.frames()[row];
    rows_of_.push_back(row);
    rows_.push_back(
        {family.Jacobian(ref.factor, s), frame.quad, PadToQuad(frame.size) / kQuad, frame.size});
    for (std::size_t k = rows_.size() - 1; k > 0 && rows_of_[k - 1] > row; --k) {
      std::swap(rows_of_[k - 1], rows_of_[k]);
      std::swap(rows_[k - 1], rows_[k]);
    }
  }
  return {rows_.data(), static_cast<int>(rows_.size()), family.residual_size()};
}

// Where the factor's products go. A block of S stays where it is while its frames do.
const std::int32_t* FactorContributions::BlocksOf(FactorRef ref) {
  const int num_slots = families_[ref.family].num_slots();
  const int num_pairs = num_slots * (num_slots + 1) / 2;
  std::int32_t* blocks = blocks_[ref.family].data() + std::ptrdiff_t{ref.factor} * num_pairs;
  if (blocks[0] < 0) {
    for (std::size_t r = 0, at = 0; r < rows_of_.size(); ++r) {
      for (std::size_t c = 0; c <= r; ++c, ++at) {
        blocks[at] = sums_.BlockOf(rows_of_[r], rows_of_[c]);
      }
    }
  }
  return blocks;
}

// In place of the one with q_out if there is one.
void FactorContributions::AddRows(const Contribution& contribution, const double* q,
                                  const double* q_out, double sign, const std::int32_t* blocks) {
  sums_.AddProducts(contribution, sign, blocks);
  sums_.AddToB(contribution, q, q_out, -sign);
  sums_.AddSquares(contribution, sign);
  sums_.Touch(rows_of_);
}

void FactorContributions::Add(FactorRef ref, double sign) {
  const Contribution contribution = RowsOf(ref);
  if (contribution.count > 0) {
    const std::int32_t* blocks = BlocksOf(ref);  // S may grow
    AddRows(contribution, families_[ref.family].q(ref.factor), nullptr, sign, blocks);
  }
}

double* FactorContributions::KeepRoom(std::ptrdiff_t count) {
  if (num_kept_ + count > static_cast<std::ptrdiff_t>(kept_.size())) {
    kept_.resize(static_cast<std::size_t>(2 * (num_kept_ + count)));
  }
  double* room = kept_.data() + num_kept_;
  num_kept_ += PadToQuad(static_cast<int>(count));
  return room;
}

std::ptrdiff_t FactorContributions::Keep(FactorRef ref) {
  const std::ptrdiff_t kept = num_kept_;
  const Contribution contribution = RowsOf(ref);
  const auto size_of = [&](const BlockRow& row) {
    return std::ptrdiff_t{contribution.depth} * row.quads * kQuad;
  };
  for (const BlockRow& row : rows_) {
    std::copy_n(row.A, size_of(row), KeepRoom(size_of(row)));
  }
  std::copy_n(families_[ref.family].q(ref.factor), contribution.depth,
              KeepRoom(contribution.depth));
  return kept;
}

void FactorContributions::Replace(FactorRef ref, std::ptrdiff_t kept) {
  Contribution contribution = RowsOf(ref);
  if (contribution.count == 0) {
    return;
  }
  const double* out = kept_.data() + kept;
  for (BlockRow& row : rows_) {
    row.out = out;
    out += std::ptrdiff_t{contribution.depth} * row.quads * kQuad;
  }
  contribution.replaces = true;
  AddRows(contribution, families_[ref.family].q(ref.factor), out, 1.0, BlocksOf(ref));
}

void FactorContributions::AddToRow(FactorRef ref, std::int32_t only) {
  const Contribution contribution = RowsOf(ref);
  targets_.clear();
  for (int r = 0; r < contribution.count; ++r) {
    for (int c = 0; c <= r; ++c) {
      const bool left_out = rows_of_[r] != only && rows_of_[c] != only;
      targets_.push_back(left_out ? -1 : sums_.BlockOf(rows_of_[r], rows_of_[c]));
    }
  }
  sums_.Touch(rows_of_);
  sums_.AddProducts(contribution, 1.0, targets_.data());
  const double* q = families_[ref.family].q(ref.factor);
  for (int r = 0; r < contribution.count; ++r) {
    if (rows_of_[r] == only) {
      const Contribution row{contribution.rows + r, 1, contribution.depth};
      sums_.AddToB(row, q, nullptr, -1.0);
      sums_.AddSquares(row, 1.0);
    }
  }
}

std::size_t FactorContributions::Bytes() const {
  std::size_t bytes = sizeof(double) * kept_.capacity();
  for (const std::vector<std::int32_t>& blocks : blocks_) {
    bytes += blocks.capacity() * sizeof(std::int32_t);
  }
  return bytes;
}

}  // namespace inceres::internal
