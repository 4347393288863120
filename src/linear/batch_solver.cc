#include "linear/batch_solver.h"

#include <algorithm>

namespace inceres::internal {

void GatheredSystem::Analyze(const SymmetricBlockRows& S) {
  rows_.clear();
  pattern_.offsets.assign(1, 0);
  pattern_.row_begin.assign(1, 0);
  pattern_.columns.clear();
  pattern_.value_begin.assign(1, 0);
  std::vector<int> place(S.num_rows(), -1);
  for (int i = 0; i < S.num_rows(); ++i) {
    if (S.size_of(i) == 0) {
      continue;
    }
    place[i] = static_cast<int>(rows_.size());
    rows_.push_back(i);
    pattern_.offsets.push_back(pattern_.offsets.back() + S.size_of(i));
    for (const SymmetricBlockRows::Entry& entry : S.row(i)) {
      pattern_.columns.push_back(place[entry.column]);
      pattern_.value_begin.push_back(pattern_.value_begin.back() + std::int64_t{S.size_of(i)} * S.size_of(entry.column));
    }
    pattern_.row_begin.push_back(static_cast<int>(pattern_.columns.size()));
  }
  row_held_.assign(rows_.size(), 0);
  values_.resize(pattern_.value_begin.back());
  diagonal_.resize(pattern_.size());
  has_values_ = false;
}

void GatheredSystem::CopyValues(const SymmetricBlockRows& S, const double* damping, const char* held, int first_row) {
  const auto first = has_values_ ? std::lower_bound(rows_.begin(), rows_.end(), first_row) : rows_.begin();
  for (int at = static_cast<int>(first - rows_.begin()); at < pattern_.num_blocks(); ++at) {
    CopyRow(S, damping, held, at);
  }
  has_values_ = true;
}

void GatheredSystem::CopyRow(const SymmetricBlockRows& S, const double* damping, const char* held, int at) {
  const int i = rows_[at];
  const int size = S.size_of(i);
  row_held_[at] = held != nullptr && held[i] != 0;
  const auto& entries = S.row(i);
  double* out = values_.data() + pattern_.value_begin[pattern_.row_begin[at]];
  for (const SymmetricBlockRows::Entry& entry : entries) {
    const int columns = S.size_of(entry.column);
    const double* block = S.values(entry.offset);
    const bool left_out = row_held_[at] != 0 || (held != nullptr && held[entry.column] != 0);
    for (int r = 0; r < size; ++r, out += columns) {
      if (left_out) {
        std::fill_n(out, columns, 0.0);
      } else {
        std::copy_n(block + static_cast<std::ptrdiff_t>(r) * PadToQuad(columns), columns, out);
      }
    }
  }
  for (int k = pattern_.offsets[at]; k < pattern_.offsets[at + 1]; ++k) {
    diagonal_[k] = row_held_[at] != 0 ? 1.0 : damping[k];
  }
}

const double* GatheredSystem::FreePart(const double* b) {
  if (std::find(row_held_.begin(), row_held_.end(), 1) == row_held_.end()) {
    return b;
  }
  b_.assign(b, b + pattern_.size());
  for (int at = 0; at < pattern_.num_blocks(); ++at) {
    if (row_held_[at] != 0) {
      std::fill(b_.begin() + pattern_.offsets[at], b_.begin() + pattern_.offsets[at + 1], 0.0);
    }
  }
  return b_.data();
}

std::size_t GatheredSystem::Bytes() const {
  const auto bytes = [](const auto& values) { return values.capacity() * sizeof(values[0]); };
  return bytes(pattern_.offsets) + bytes(pattern_.row_begin) + bytes(pattern_.columns) + bytes(pattern_.value_begin) +
         bytes(rows_) + bytes(row_held_) + bytes(values_) + bytes(diagonal_) + bytes(b_);
}

}  // namespace inceres::internal
