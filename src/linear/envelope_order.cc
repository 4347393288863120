#include "linear/envelope_order.h"

#include <algorithm>
#include <cmath>

namespace inceres::internal {
namespace {

// A row coupled to more than 10 √n others (and more than 16) is put last: the rule AMD has for such rows.
constexpr double kDenseShare = 10.0;
constexpr double kMinDense = 16.0;

bool IsHeld(const char* held, int row) {
  return held != nullptr && held[row] != 0;
}

// Flops of the rows [begin, end): of offset(i) and first(i), the first scalar and the first column of the row at place i.
template <typename Offset, typename First>
double SumFlops(int begin, int end, const Offset& offset, const First& first) {
  double flops = 0.0;
  for (int i = begin; i < end; ++i) {
    const double rows = offset(i + 1) - offset(i);
    for (int j = first(i); j <= i; ++j) {
      const double columns = offset(j + 1) - offset(j);
      const double depth = offset(j) - offset(std::max(first(i), first(j)));
      flops += rows * columns * (2.0 * depth + columns) * (j == i ? 0.5 : 1.0);
    }
  }
  return flops;
}

// Both triangles of S as lists of neighbours.
std::vector<std::vector<int>> Neighbours(const SymmetricBlockRows& S) {
  std::vector<std::vector<int>> neighbours(S.num_rows());
  for (int i = 0; i < S.num_rows(); ++i) {
    for (const SymmetricBlockRows::Entry& entry : S.row(i)) {
      if (entry.column != i) {
        neighbours[i].push_back(entry.column);
        neighbours[entry.column].push_back(i);
      }
    }
  }
  return neighbours;
}

// Breadth first, from the last place to the first.
class ReversedOrder {
 public:
  explicit ReversedOrder(const SymmetricBlockRows& S) : neighbours_(Neighbours(S)), taken_(S.num_rows(), 0) {
    for (int row = 0; row < S.num_rows(); ++row) {
      taken_[row] = S.size_of(row) == 0;
    }
  }

  void TakeDenseRows() {
    const double limit = std::max(kMinDense, kDenseShare * std::sqrt(static_cast<double>(taken_.size())));
    for (int row = static_cast<int>(taken_.size()) - 1; row >= 0; --row) {
      if (static_cast<double>(neighbours_[row].size()) > limit) {
        Take(row);
      }
    }
    next_ = rows_.size();  // neighbours of these say nothing about the order
  }

  // The next `count` of the newest rows that are left.
  void TakeNewest(int count) {
    for (; newest_ > 0 && count > 0; --newest_) {
      count -= Take(newest_ - 1);
    }
  }

  // Everything connected with the rows taken, nearest first, among equals those with fewer neighbours.
  void TakeConnected() {
    for (; next_ < rows_.size(); ++next_) {
      std::vector<int>& near = neighbours_[rows_[next_]];
      std::stable_sort(near.begin(), near.end(), [this](int a, int b) { return neighbours_[a].size() < neighbours_[b].size(); });
      for (const int row : near) {
        Take(row);
      }
    }
  }

  bool HasMore() const { return newest_ > 0; }
  const std::vector<int>& rows() const { return rows_; }

 private:
  bool Take(int row) {
    if (taken_[row] != 0) {
      return false;
    }
    taken_[row] = 1;
    rows_.push_back(row);
    return true;
  }

  std::vector<std::vector<int>> neighbours_;
  std::vector<char> taken_;
  std::vector<int> rows_;
  std::size_t next_ = 0;  // the row of rows_ whose neighbours come next
  int newest_ = static_cast<int>(taken_.size());
};

}  // namespace

int FirstFreeColumn(const SymmetricBlockRows& S, const char* held, int i) {
  if (!IsHeld(held, i)) {
    for (const SymmetricBlockRows::Entry& entry : S.row(i)) {
      if (!IsHeld(held, entry.column)) {
        return entry.column;
      }
    }
  }
  return i;
}

double EnvelopeFlops(const SymmetricBlockRows& S, const char* held, int first_row, std::vector<int>* workspace) {
  int lowest = S.num_rows();
  for (int i = first_row; i < S.num_rows(); ++i) {
    lowest = std::min(lowest, FirstFreeColumn(S, held, i));
  }
  // Per row its offset and its first column; one offset more.
  workspace->resize(2 * static_cast<std::size_t>(S.num_rows() - lowest) + 1);
  int* offsets = workspace->data();
  int* first = offsets + (S.num_rows() - lowest) + 1;
  offsets[0] = 0;
  for (int i = lowest; i < S.num_rows(); ++i) {
    offsets[i - lowest + 1] = offsets[i - lowest] + S.size_of(i);
    first[i - lowest] = std::max(lowest, FirstFreeColumn(S, held, i));
  }
  return SumFlops(
      first_row, S.num_rows(), [&](int i) { return offsets[i - lowest]; }, [&](int i) { return first[i - lowest]; });
}

double EnvelopeFlops(const SymmetricBlockRows& S, const std::vector<int>& order) {
  const auto count = static_cast<int>(order.size());
  std::vector<int> place(S.num_rows(), -1);
  std::vector<int> offsets{0};
  std::vector<int> first(count);
  for (int k = 0; k < count; ++k) {
    place[order[k]] = first[k] = k;
    offsets.push_back(offsets.back() + S.size_of(order[k]));
  }
  for (int k = 0; k < count; ++k) {
    for (const SymmetricBlockRows::Entry& entry : S.row(order[k])) {
      const int other = place[entry.column];
      if (other >= 0) {
        const int later = std::max(k, other);
        first[later] = std::min({first[later], k, other});
      }
    }
  }
  return SumFlops(
      0, count, [&](int i) { return offsets[i]; }, [&](int i) { return first[i]; });
}

std::vector<int> EnvelopeOrder(const SymmetricBlockRows& S, int num_newest) {
  ReversedOrder reversed(S);
  reversed.TakeDenseRows();
  reversed.TakeNewest(num_newest);
  reversed.TakeConnected();
  while (reversed.HasMore()) {
    reversed.TakeNewest(1);
    reversed.TakeConnected();
  }
  return {reversed.rows().rbegin(), reversed.rows().rend()};
}

}  // namespace inceres::internal
