#include "linear/envelope_order.h"

#include <algorithm>
#include <cmath>

namespace inceres::internal {

// What an order of the rows costs inside the envelope, and how to find a better one
// (docs/algorithms.md, "Reduced linear systems", resuming). The envelope of a row begins at the
// first place that it is coupled to; the flops follow from these starts alone, at one operation a
// pair of block rows.
//
// The order sought is reversed Cuthill–McKee (Cuthill & McKee 1969; George & Liu 1981, chapter 4),
// with a start that is given: the rows that change now come last, because what changes next is most
// likely near them, and only what is behind a change is factored again. From them the search goes
// out by breadth, and the list is turned around in the end. Everything is decided by structure and
// index.

namespace {

// A row coupled to more than 10 √n others (and more than 16) is put last: the rule AMD has for such
// rows.
constexpr double kDenseShare = 10.0;
constexpr double kMinDense = 16.0;

}  // namespace

// S keeps to the order of arrival: of the two triangles either may have what is ahead in this
// order.
int FirstFreeColumn(const SymmetricBlockRows& S, const char* held, const RowOrder& order, int k) {
  const int row = order.row(k);
  if (IsHeld(held, row)) {
    return k;
  }
  int first = k;
  S.ForEachCoupled(row, [&](int other) {
    const int place = order.place(other);
    if (place >= 0 && place < first && !IsHeld(held, other)) {
      first = place;
    }
  });
  return first;
}

// For each block of the row its sum is as deep as both rows reach back together. A multiplication
// and an addition count as two, the triangular solve as columns², and of the diagonal block one
// half is computed.
RowWork WorkOfRows(const int* first, const int* offset, int begin, int end) {
  RowWork work;
  for (int i = begin; i < end; ++i) {
    const double rows = offset[i + 1] - offset[i];
    for (int j = first[i]; j <= i; ++j) {
      const double columns = offset[j + 1] - offset[j];
      const double depth = offset[j] - offset[std::max(first[i], first[j])];
      const double entries = rows * columns * (j == i ? 0.5 : 1.0);
      work.flops += entries * (2.0 * depth + columns);
      work.entries += entries;
    }
  }
  return work;
}

RowWork EnvelopeWork(const SymmetricBlockRows& S, const char* held, const RowOrder& order,
                     int first_place, std::vector<int>* workspace) {
  const int num_places = order.num_places();
  // Per place its first column, then per place from the lowest of those on its offset; one offset
  // more.
  workspace->resize(2 * static_cast<std::size_t>(num_places) + 1);
  int* first = workspace->data();
  int* offset = first + num_places;
  int lowest = num_places;
  for (int i = first_place; i < num_places; ++i) {
    first[i] = FirstFreeColumn(S, held, order, i);
    lowest = std::min(lowest, first[i]);
  }
  // Of rows that stay only the columns count that the others meet: from the lowest start on.
  for (int i = lowest; i < first_place; ++i) {
    first[i] = std::max(lowest, FirstFreeColumn(S, held, order, i));
  }
  offset[lowest] = 0;
  for (int i = lowest; i < num_places; ++i) {
    offset[i + 1] = offset[i] + S.size_of(order.row(i));
  }
  return WorkOfRows(first, offset, first_place, num_places);
}

const std::vector<int>& EnvelopeOrdering::Reorder(const SymmetricBlockRows& S,
                                                  const RowOrder& order, int first_place,
                                                  const std::vector<int>& last) {
  // rows_ grows from the last place backwards.
  Begin(S, order, first_place);
  TakeDenseRows(S, order, first_place);
  next_ = rows_.size();  // neighbors of these say nothing about the order
  last_places_.clear();
  for (const int row : last) {
    last_places_.push_back(order.place(row));
  }
  std::sort(last_places_.begin(), last_places_.end());
  // In the order they have, from the back.
  for (auto place = last_places_.rbegin(); place != last_places_.rend() && *place >= first_place;
       ++place) {
    Take(order.row(*place));
  }
  TakeConnected(S);
  // What is left has nothing to do with those.
  for (int place = order.num_places() - 1; place >= first_place; --place) {
    Take(order.row(place));
    TakeConnected(S);
  }
  std::reverse(rows_.begin(), rows_.end());
  return rows_;
}

void EnvelopeOrdering::Begin(const SymmetricBlockRows& S, const RowOrder& order, int first_place) {
  rows_.clear();
  // Rows that stay in front, and those without a place, count as taken and are never reached.
  taken_.assign(S.num_rows(), 1);
  for (int place = first_place; place < order.num_places(); ++place) {
    taken_[order.row(place)] = 0;
  }
}

void EnvelopeOrdering::TakeDenseRows(const SymmetricBlockRows& S, const RowOrder& order,
                                     int first_place) {
  const double limit =
      std::max(kMinDense, kDenseShare * std::sqrt(static_cast<double>(order.num_places())));
  for (int place = order.num_places() - 1; place >= first_place; --place) {
    // Such a row would draw all others close together in the search: it says nothing about
    // distances.
    if (static_cast<double>(S.Degree(order.row(place))) > limit) {
      Take(order.row(place));
    }
  }
}

// Everything connected with the rows taken, nearest first, among equals those with fewer neighbors.
void EnvelopeOrdering::TakeConnected(const SymmetricBlockRows& S) {
  for (; next_ < rows_.size(); ++next_) {
    near_.clear();
    S.ForEachCoupled(rows_[next_], [this](int other) {
      if (taken_[other] == 0) {
        near_.push_back(other);
      }
    });
    // A complete order: equal degrees are told apart by index.
    std::sort(near_.begin(), near_.end(), [&S](int a, int b) {
      return S.Degree(a) != S.Degree(b) ? S.Degree(a) < S.Degree(b) : a < b;
    });
    for (const int other : near_) {
      Take(other);
    }
  }
}

void EnvelopeOrdering::Take(int row) {
  if (taken_[row] == 0) {
    taken_[row] = 1;
    rows_.push_back(row);
  }
}

}  // namespace inceres::internal
