#include "distributed/fine_blocks.h"

#include <algorithm>
#include <utility>

#include "base/sort_unique.h"
#include "linear/pattern_rows.h"

namespace inceres::internal {

// The fine part D of the two-level preconditioner, M⁻¹ = (I − Q A) D⁻¹ (I − A Q) + Q
// (docs/distributed.md, "The two-level preconditioner"). D has those blocks of S + Λ_c whose two
// frames are in the same aggregate and have the same owner, so it is block diagonal by owners:
// applying D⁻¹ sends nothing, and M remains symmetric. What it loses against one process are blocks
// of an aggregate that several ranks own.
//
// A block of S is a sum over the ranks that see both frames. Once, they tell its owner which blocks
// they have a part of; for each factorization they send values in that order. Kept: the lists, the
// pattern of the owned blocks in the order of the owned frames, their sums and the factor.

namespace {

using BlockKey = std::pair<int, int>;  // row, column

// A block by the numbers of its frames among those of all ranks, which all ranks know.
struct SentKey {
  int row;
  int column;
};

}  // namespace

FineBlocks::FineBlocks(const Communicator& ranks, const SharedFrames& frames,
                       const BlockPattern& pattern, const FrameClusters& clusters,
                       const Executor& executor, Status* status)
    : ranks_(ranks),
      frames_(frames),
      pattern_(pattern),
      sent_(ranks.size()),
      row_of_number_(frames.sizes().size(), -1) {
  CollectParts(clusters);
  const FrameClusters whole = BuildOwned();
  values_.resize(static_cast<std::size_t>(owned_.value_begin.back()));
  Status own;
  factor_ = std::make_unique<ClusterCholesky>(owned_, whole, executor, &own);
  *status = ranks.Agree(own);
}

// Blocks of the lower half, by the numbers of the frames. The local pattern is lower triangular by
// positions in the layout, the owned one by numbers; where the two orders differ, the block is
// transposed. By construction of the clusters both frames have one owner, so that of the row will
// do. By ascending row and column of the local pattern, so lists of parts have one order on each
// rank, in which keys and later values are sent.
void FineBlocks::CollectParts(const FrameClusters& clusters) {
  for (int i = 0; i < pattern_.num_blocks(); ++i) {
    for (int k = pattern_.row_begin[i]; k < pattern_.row_begin[i + 1]; ++k) {
      const FramePlace& row = frames_.moving()[i];
      const FramePlace& column = frames_.moving()[pattern_.columns[k]];
      if (clusters.Keeps(i, pattern_.columns[k])) {
        const bool transposed = row.number < column.number;
        const Part part{k, transposed ? column.number : row.number,
                        transposed ? row.number : column.number, transposed};
        (row.owner == ranks_.rank() ? own_ : sent_[row.owner]).push_back(part);
      }
    }
  }
}

// The pattern of the blocks owned here, of all ranks' parts: all of it is kept.
// Returns one cluster of all, since only what belongs into D is in the pattern: the factor is of
// everything there.
FrameClusters FineBlocks::BuildOwned() {
  owned_.offsets.push_back(0);
  for (const int position : frames_.owned()) {
    const FramePlace& place = frames_.moving()[position];
    row_of_number_[place.number] = owned_.num_blocks();
    owned_.offsets.push_back(owned_.offsets.back() + place.sizes[FramePlace::kTangent]);
  }
  std::vector<std::vector<SentKey>> keys(sent_.size());
  for (std::size_t r = 0; r < sent_.size(); ++r) {
    for (const Part& part : sent_[r]) {
      keys[r].push_back({part.row, part.column});
    }
  }
  // In the order of the ranks, of each in the order in which Factorize will send values.
  const std::vector<SentKey> received = ranks_.SendToEach(std::move(keys));
  std::vector<BlockKey> blocks;
  const auto add = [&](int row, int column) {
    blocks.emplace_back(row_of_number_[row], row_of_number_[column]);
  };
  std::for_each(own_.begin(), own_.end(), [&](const Part& p) { add(p.row, p.column); });
  std::for_each(received.begin(), received.end(), [&](const SentKey& k) { add(k.row, k.column); });
  SortUnique(&blocks);
  // Sorted by row and column, the diagonal block is the last one of its row, and every row has it,
  // for the owner's own factors touch each frame it owns.
  owned_.row_begin.assign(1, 0);
  owned_.value_begin.assign(1, 0);
  for (const auto& [row, column] : blocks) {
    owned_.columns.push_back(column);
    owned_.value_begin.push_back(owned_.value_begin.back() +
                                 std::int64_t{owned_.block_size(row)} * owned_.block_size(column));
    if (row == column) {  // the last one of its row
      owned_.row_begin.push_back(static_cast<int>(owned_.columns.size()));
    }
  }
  std::transform(own_.begin(), own_.end(), std::back_inserter(own_to_),
                 [this](const Part& p) { return FindOwned(p.row, p.column); });
  std::transform(received.begin(), received.end(), std::back_inserter(received_to_),
                 [this](const SentKey& k) { return FindOwned(k.row, k.column); });
  FrameClusters whole;
  whole.cluster_of.assign(owned_.num_blocks(), 0);
  return whole;
}

// The block is there: the pattern was built from the same keys.
int FineBlocks::FindOwned(int row, int column) const {
  return FindBlock(owned_, row_of_number_[row], row_of_number_[column]);
}

// Values row-major by the numbers of the frames, as the owner adds them.
void FineBlocks::Append(const double* S, const Part& part, std::vector<double>* values) const {
  const int rows = frames_.sizes()[part.row], columns = frames_.sizes()[part.column];
  const double* const block = S + pattern_.value_begin[part.block];
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      values->push_back(part.is_transposed ? block[c * rows + r] : block[r * columns + c]);
    }
  }
}

void FineBlocks::Add(const double* values, int block) {
  const std::int64_t begin = owned_.value_begin[block];
  for (std::int64_t k = begin; k < owned_.value_begin[block + 1]; ++k) {
    values_[k] += values[k - begin];
  }
}

// The own part first, then those of the others in the order of the ranks.
Status FineBlocks::Factorize(const double* S, const std::vector<double>& owned_damping) {
  std::fill(values_.begin(), values_.end(), 0.0);
  std::vector<double> block;
  for (std::size_t k = 0; k < own_.size(); ++k) {
    block.clear();
    Append(S, own_[k], &block);
    Add(block.data(), own_to_[k]);
  }
  std::vector<std::vector<double>> to_rank(sent_.size());
  for (std::size_t r = 0; r < sent_.size(); ++r) {
    for (const Part& part : sent_[r]) {
      Append(S, part, &to_rank[r]);
    }
  }
  // Keys have told where each block goes; only values are sent.
  const std::vector<double> received = ranks_.SendToEach(std::move(to_rank));
  const double* next = received.data();
  for (const int to : received_to_) {
    Add(next, to);
    next += owned_.value_begin[to + 1] - owned_.value_begin[to];
  }
  // Λ_c is added to the sums, once. A block without a factor on one rank is a failure of all: they
  // would part otherwise.
  return ranks_.Agree(factor_->Factorize(values_.data(), owned_damping.data()));
}

std::int64_t FineBlocks::Bytes() const {
  std::size_t parts = own_.size();
  for (const std::vector<Part>& of_rank : sent_) {
    parts += of_rank.size();
  }
  return factor_->Bytes() +
         static_cast<std::int64_t>(parts * sizeof(Part) + values_.size() * sizeof(double) +
                                   (own_to_.size() + received_to_.size()) * sizeof(int));
}

}  // namespace inceres::internal
