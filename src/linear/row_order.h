#pragma once

#include <vector>

#include "linear/block_rows.h"
#include "linear/seen_rows.h"

namespace inceres::internal {

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
