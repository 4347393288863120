#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "linear/block_rows.h"

namespace inceres::internal {

/// What somebody who follows the rows of an S that is edited has seen of them.
class SeenRows {
 public:
  /// Whether all rows that were there at the last call, for the same S, are as they were: then only
  /// new ones are to be looked at.
  bool OnlyGrew(const SymmetricBlockRows& S) {
    const bool only_grew = &S == S_ && S.resized_version() == version_;
    S_ = &S;
    version_ = S.resized_version();
    return only_grew;
  }
  /// Nothing has been seen.
  void Forget() { S_ = nullptr; }

 private:
  const SymmetricBlockRows* S_ = nullptr;
  std::int64_t version_ = 0;
};

/// Where the rows of an S that is edited begin in vectors packed by rows.
class RowPacking {
 public:
  /// Takes over what has come, gone or got another size. True if a row that was known before begins
  /// elsewhere now. Cost: the rows that have come, as long as none has gone.
  bool Follow(const SymmetricBlockRows& S) {
    const std::size_t known = offsets_.size() - 1, count = static_cast<std::size_t>(S.num_rows());
    const bool only_new = seen_.OnlyGrew(S) && known <= count;
    offsets_.resize(count + 1);
    bool has_moved = false;
    for (std::size_t row = only_new ? known : 0; row < count; ++row) {
      const int end = offsets_[row] + S.size_of(static_cast<int>(row));
      has_moved |= row < known && offsets_[row + 1] != end;
      offsets_[row + 1] = end;
    }
    return has_moved;
  }

  int operator[](int row) const { return offsets_[static_cast<std::size_t>(row)]; }
  int size() const { return offsets_.back(); }
  int num_rows() const { return static_cast<int>(offsets_.size()) - 1; }

 private:
  std::vector<int> offsets_{0};  // by row, one more: the size
  SeenRows seen_;
};

/// The order in which block rows of S are factored: all living ones, or some. Each has a place,
/// places have no gaps. What comes at one place says nothing about the places before it, so
/// everything from some place on may be put in another order while a factor stays right before it.
class RowOrder {
 public:
  int num_places() const { return static_cast<int>(rows_.size()); }
  int row(int place) const { return rows_[place]; }
  /// -1: it has none.
  int place(int row) const { return row < static_cast<int>(places_.size()) ? places_[row] : -1; }
  const std::vector<int>& rows() const { return rows_; }

  /// Rows that S no longer has give up their places, none of them before `first_place`; rows that
  /// have none get the last ones.
  void Follow(const SymmetricBlockRows& S, int first_place) {
    const int known = static_cast<int>(places_.size());
    places_.resize(S.num_rows(), -1);
    int kept = first_place;
    for (int k = first_place; k < num_places(); ++k) {
      const int row = rows_[k];
      places_[row] = S.size_of(row) > 0 ? kept : -1;
      rows_[kept] = row;
      kept += S.size_of(row) > 0 ? 1 : 0;
    }
    rows_.resize(kept);
    // Rows known before have their places, unless one has come back.
    for (int row = seen_.OnlyGrew(S) ? known : 0; row < S.num_rows(); ++row) {
      if (S.size_of(row) > 0 && places_[row] < 0) {
        places_[row] = num_places();
        rows_.push_back(row);
      }
    }
  }

  /// No row has a place.
  void Clear() {
    for (const int row : rows_) {
      places_[row] = -1;
    }
    rows_.clear();
    seen_.Forget();
  }
  /// Gives a row that has none the next place. `num_rows`: of S.
  void Append(int row, int num_rows) {
    places_.resize(num_rows, -1);
    rows_.reserve(num_rows);
    places_[row] = num_places();
    rows_.push_back(row);
    seen_.Forget();
  }

  /// Another order of the rows that have the last tail.size() places.
  void SetTail(const std::vector<int>& tail) {
    const int first_place = num_places() - static_cast<int>(tail.size());
    for (int k = first_place; k < num_places(); ++k) {
      rows_[k] = tail[k - first_place];
      places_[rows_[k]] = k;
    }
  }

 private:
  std::vector<int> rows_;    // by place
  std::vector<int> places_;  // by row of S
  SeenRows seen_;            // by Follow
};

}  // namespace inceres::internal
