#pragma once

#include <cstdint>
#include <vector>

#include "incremental/index_set.h"

namespace inceres::internal {

/// Which rows of S and entries of b have changed, for each of those who follow them: what has since
/// it asked last, ascending. The vectors' memory is used again.
class RowChanges {
 public:
  /// Makes room for rows < num_rows.
  void Grow(std::size_t num_rows) {
    for (IndexSet* set : {&formed_, &unfactored_, &unsolved_, &unread_, &unchecked_, &uninverted_,
                          &unbounded_, &unjudged_}) {
      set->Grow(num_rows);
    }
  }

  /// A row of S, and with it the row's entries of b.
  void Touch(std::int32_t row) {
    formed_.Add(row);
    unfactored_.Add(row);
    uninverted_.Add(row);
    unjudged_.Add(row);
    TouchB(row);
  }
  /// Its entries of b alone.
  void TouchB(std::int32_t row) {
    unsolved_.Add(row);
    unread_.Add(row);
    unchecked_.Add(row);
    unbounded_.Add(row);
  }
  /// Neither, but the frame has other values.
  void TouchValues(std::int32_t row) { unbounded_.Add(row); }
  /// Neither, but it has another offset.
  void TouchOffset(std::int32_t row) { unread_.Add(row); }

  /// The rows of S.
  void TakeRowsOfS(std::vector<std::int32_t>* rows) { Take(&formed_, rows); }
  /// The same for whoever factors S, and the entries of b for whoever solves.
  void TakeUnfactored(std::vector<std::int32_t>* rows) { Take(&unfactored_, rows); }
  void TakeUnsolved(std::vector<std::int32_t>* rows) { Take(&unsolved_, rows); }
  /// For whoever keeps a factor for covariances.
  void TakeUninverted(std::vector<std::int32_t>* rows) { Take(&uninverted_, rows); }
  /// For whoever keeps which of them are weak.
  void TakeUnjudged(std::vector<std::int32_t>* rows) { Take(&unjudged_, rows); }
  /// For whoever bounds what rounding does: all of it, and values.
  void TakeUnbounded(std::vector<std::int32_t>* rows) { Take(&unbounded_, rows); }
  /// How many rows of S whoever factors it has not seen.
  int num_unfactored() const { return unfactored_.count(); }
  /// For whoever packs b and the diagonals: all of it.
  void TakeUnread(std::vector<std::int32_t>* rows) { Take(&unread_, rows); }
  /// For whoever looks for drift: rows of S and entries of b. What he changes himself he has seen:
  /// he clears them at the end.
  const IndexSet& unchecked() const { return unchecked_; }
  void ClearUnchecked() { unchecked_.Clear(); }

 private:
  static void Take(IndexSet* set, std::vector<std::int32_t>* rows) {
    set->CopyTo(rows);
    set->Clear();
  }

  IndexSet formed_;
  IndexSet unfactored_;
  IndexSet uninverted_;
  IndexSet unjudged_;
  IndexSet unsolved_;
  IndexSet unread_;
  IndexSet unchecked_;
  IndexSet unbounded_;
};

}  // namespace inceres::internal
