// The contributions of factors to S and b.

#include <algorithm>

#include "incremental/schur_sums.h"

namespace inceres::internal {

// J_cᵀJ_c of S and −J_cᵀq of b (docs/algorithms.md, "Incremental Schur complement"): one factor's
// frames only. Where a factor has a landmark, −Y Yᵀ and −Y z are that landmark's contribution.
//
// A contribution that is to be taken out must be exactly the one that went in, or rounding is not
// all that stays behind: hence q and the Jacobians are copied (KeepFactor) before a family
// linearizes anew, and ReplaceFactor subtracts the copy and adds the new one in one pass over S.
// The blocks that a factor's products go to are looked up once and remembered; blocks of S do not
// move while anybody has products there.
//
// A factor that is turned off, as a loop that was found wrong, has no blocks: between two frames
// that nothing else couples S has none then, and its factor no fill.

void SchurSums::ConnectFactor(FactorRef ref) {
  const IncrementalFamily& family = families_[ref.family];
  const std::size_t num_pairs =
      static_cast<std::size_t>(family.num_slots()) * (family.num_slots() + 1) / 2;
  factor_blocks_.resize(families_.size());
  std::vector<std::int32_t>& blocks = factor_blocks_[ref.family];
  if (blocks.size() < family.num_places() * num_pairs) {
    blocks.resize(family.num_places() * num_pairs, -1);
  }
  // Only the first entry tells; the others are written together with it.
  blocks[ref.factor * num_pairs] = -1;
}

// The frames of a factor with their Jacobians, ascending, into factor_frames_ and as many of
// factor_rows_. Insertion keeps the rows ascending: products fill the lower triangle, so the first
// frame of a pair must have the larger row. A factor has few frames.
Contribution SchurSums::RowsOf(FactorRef ref) {
  const IncrementalFamily& family = families_[ref.family];
  const int num_slots = family.num_slots();
  const std::int32_t* const frames = structure_.FramesOfFactor(ref);
  const SlotJacobians* const slots = family.slots();
  factor_frames_.resize(num_slots);
  if (factor_rows_.size() < static_cast<std::size_t>(num_slots)) {
    factor_rows_.resize(num_slots);
  }
  std::int32_t* const rows_of = factor_frames_.data();
  BlockRow* const rows = factor_rows_.data();
  int count = 0;
  for (int s = 0; s < num_slots; ++s) {
    const std::int32_t row = frames[s];
    if (row < 0) {
      continue;
    }
    int at = count++;
    for (; at > 0 && rows_of[at - 1] > row; --at) {
      rows_of[at] = rows_of[at - 1];
      rows[at] = rows[at - 1];
    }
    const IncrementalStructure::Frame& frame = structure_.frames()[row];
    rows_of[at] = row;
    // Rows of a slot are padded to quads, as the frame's entries are.
    rows[at] = {slots[s].data + ref.factor * slots[s].factor_stride, frame.quad,
                slots[s].row_stride / kQuad, frame.size};
  }
  factor_frames_.resize(count);
  return {rows, count, family.residual_size()};
}

void SchurSums::DisconnectFactor(FactorRef ref) {
  RowsOf(ref);
  ReleaseBlocks(ref);
}

// Of the frames in factor_frames_. What a landmark sees both frames of is left alone: its products
// go to the same blocks.
void SchurSums::ReleaseBlocks(FactorRef ref) {
  if (!HasBlocks(ref)) {
    return;
  }
  FactorBlocks(ref)[0] = -1;
  for (std::size_t r = 0; r < factor_frames_.size(); ++r) {
    for (std::size_t c = 0; c < r; ++c) {
      if (!IsCoupled(factor_frames_[r], factor_frames_[c])) {
        S_.RemoveBlock(factor_frames_[r], factor_frames_[c]);
      }
    }
  }
  Touch(factor_frames_);
}

// Whether a block of S between these may be somebody's.
bool SchurSums::IsCoupled(std::int32_t row, std::int32_t column) {
  const IncrementalStructure::Frame &a = structure_.frames()[row], &b = structure_.frames()[column];
  if (!a.landmarks.empty() && !b.landmarks.empty()) {
    return true;
  }
  return std::any_of(a.factors.begin(), a.factors.end(), [&](const FactorRef& ref) {
    return HasBlocks(ref) && structure_.Touches(ref, column);
  });
}

// By a loss that has no influence whatever the residual; not by one that has none at this residual
// only, as Tukey's. Asked when Jacobians are those of the loss, so they and its weight are zero
// then.
bool SchurSums::IsTurnedOff(FactorRef ref) const {
  if (families_[ref.family].weighed().weight(ref.factor) != 0.0) {
    return false;
  }
  const auto* const loss = dynamic_cast<const ScaledLoss*>(families_[ref.family].loss(ref.factor));
  return loss != nullptr && loss->scale() == 0.0;
}

// Where the factor's products go. A block of S stays where it is while its frames do.
const std::int32_t* SchurSums::BlocksOf(FactorRef ref) {
  std::int32_t* blocks = FactorBlocks(ref);
  if (blocks[0] < 0) {
    // The lower triangle of the factor's frames, row by row, as the kernels count. Slots outside
    // the system have no row, so not all entries may be in use.
    for (std::size_t r = 0, at = 0; r < factor_frames_.size(); ++r) {
      for (std::size_t c = 0; c <= r; ++c, ++at) {
        blocks[at] = BlockOf(factor_frames_[r], factor_frames_[c]);
      }
    }
  }
  return blocks;
}

void SchurSums::AddFactor(FactorRef ref, double sign) {
  if (SumFactor(ref, sign)) {
    Touch(factor_frames_);
  }
}

// b has −J_cᵀq, so it gets the opposite sign of S. The peaks that drift is judged by are kept up in
// the same kernel. BlocksOf may add blocks to S and move its values, so it comes before the kernel
// is given pointers.
bool SchurSums::SumFactor(FactorRef ref, double sign) {
  const bool is_there = sign > 0.0 ? !IsTurnedOff(ref) : HasBlocks(ref);
  const Contribution contribution = RowsOf(ref);
  if (contribution.count == 0 || !is_there) {
    return false;
  }
  const std::int32_t* blocks = BlocksOf(ref);  // S may grow
  AddContribution(contribution, families_[ref.family].weighed().q(ref.factor), nullptr, sign,
                  blocks);
  return true;
}

double* SchurSums::KeepRoom(std::ptrdiff_t count) {
  // Twice what is needed, for it is followed by others. Growing moves the copies, so that callers
  // hold offsets and not pointers.
  if (num_kept_ + count > static_cast<std::ptrdiff_t>(kept_.size())) {
    kept_.resize(static_cast<std::size_t>(2 * (num_kept_ + count)));
  }
  double* room = kept_.data() + num_kept_;
  // Whole quads: each copy begins as well aligned as the first.
  num_kept_ += PadToQuad(static_cast<int>(count));
  return room;
}

// Even a factor without a frame returns a place: ReplaceFactor skips it by its count.
std::ptrdiff_t SchurSums::KeepFactor(FactorRef ref) {
  const std::ptrdiff_t kept = num_kept_;
  const Contribution contribution = RowsOf(ref);
  const auto size_of = [&](const BlockRow& row) {
    return std::ptrdiff_t{contribution.depth} * row.quads * kQuad;
  };
  for (int r = 0; r < contribution.count; ++r) {
    std::copy_n(factor_rows_[r].A, size_of(factor_rows_[r]), KeepRoom(size_of(factor_rows_[r])));
  }
  std::copy_n(families_[ref.family].weighed().q(ref.factor), contribution.depth,
              KeepRoom(contribution.depth));
  return kept;
}

void SchurSums::ReplaceFactor(FactorRef ref, std::ptrdiff_t kept) {
  Contribution contribution = RowsOf(ref);
  if (contribution.count == 0) {
    return;
  }
  // Rows lie in the order of RowsOf, padded as in the family, and q behind them. The frames of a
  // factor do not change since KeepFactor, so the order is the same.
  const double* out = kept_.data() + kept;
  for (int r = 0; r < contribution.count; ++r) {
    factor_rows_[r].out = out;
    out += std::ptrdiff_t{contribution.depth} * factor_rows_[r].quads * kQuad;
  }
  contribution.replaces = true;
  const bool is_off = IsTurnedOff(ref);
  if (!is_off || HasBlocks(ref)) {
    const std::int32_t* blocks = BlocksOf(ref);
    AddContribution(contribution, families_[ref.family].weighed().q(ref.factor), out, 1.0, blocks);
    Touch(factor_frames_);
  }
  if (is_off) {
    ReleaseBlocks(ref);
  }
}

// For a row that is summed anew (rebuilding, drift). Its column belongs to other rows, which
// change as well and are marked, but their b and diag(C) stay: those have this factor already.
void SchurSums::AddFactorToRow(FactorRef ref, std::int32_t only) {
  if (IsTurnedOff(ref)) {
    return;
  }
  const Contribution contribution = RowsOf(ref);
  factor_targets_.clear();
  for (int r = 0; r < contribution.count; ++r) {
    for (int c = 0; c <= r; ++c) {
      const bool left_out = factor_frames_[r] != only && factor_frames_[c] != only;
      factor_targets_.push_back(left_out ? -1 : BlockOf(factor_frames_[r], factor_frames_[c]));
    }
  }
  Touch(factor_frames_);
  AddProducts(contribution, 1.0, factor_targets_.data());
  const double* q = families_[ref.family].weighed().q(ref.factor);
  for (int r = 0; r < contribution.count; ++r) {
    if (factor_frames_[r] == only) {
      const Contribution row{contribution.rows + r, 1, contribution.depth};
      AddToB(row, q, nullptr, -1.0);
      AddSquares(row, 1.0);
    }
  }
}

}  // namespace inceres::internal
