#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "src/base/counting_sort.h"
#include "src/base/executor.h"

namespace inceres::internal {

/// An index kept as a signed number, for a std::vector.
inline std::size_t At(std::int64_t i) {
  return static_cast<std::size_t>(i);
}

/// Items by row.
struct CompressedRows {
  struct Row {
    const int* first;
    const int* last;
    const int* begin() const { return first; }
    const int* end() const { return last; }
    int size() const { return static_cast<int>(last - first); }
  };
  Row operator[](int row) const {
    return {items.data() + begin[At(row)], items.data() + begin[At(row) + 1]};
  }

  std::vector<int> begin;  ///< of each row, into items; one more than rows
  std::vector<int> items;
};

/// Calls for_each(add) twice, which calls add(row, item) for every item: a counting sort, items of
/// one row as they come.
template <typename ForEach>
CompressedRows SortIntoRows(std::size_t num_rows, const ForEach& for_each) {
  CompressedRows rows;
  CountingSort(num_rows, for_each, &rows.begin, &rows.items);
  return rows;
}

/// The same of items 0, 1, …, of which each goes to its row, or nowhere if that is −1.
inline CompressedRows SortIntoRows(std::size_t num_rows, const std::vector<int>& row_of) {
  return SortIntoRows(num_rows, [&row_of](const auto& add) {
    for (std::size_t i = 0; i < row_of.size(); ++i) {
      if (row_of[i] >= 0) {
        add(row_of[i], static_cast<int>(i));
      }
    }
  });
}

/// Dense indices of addresses: an open-addressing hash table of the indices, filled in one go. Cost
/// of a lookup: about one line of the cache in the table and one in the addresses.
class PointerIndex {
 public:
  /// Index i belongs to pointers[i]; the pointers are distinct and not null.
  template <typename T>
  void Build(const std::vector<T*>& pointers) {
    Reserve(pointers.size());
    for (T* pointer : pointers) {
      FindOrAdd(pointer);
    }
  }
  /// Nothing yet, and room for so many.
  void Reserve(std::size_t count) {
    int bits = 4;
    while ((std::size_t{1} << bits) < 2 * count) {
      ++bits;
    }
    shift_ = 64 - bits;
    mask_ = (std::size_t{1} << bits) - 1;
    table_.assign(mask_ + 1, -1);
    pointers_.clear();
    pointers_.reserve(count);
  }
  /// The index of a pointer, not null, which is the next one if it was not there.
  int FindOrAdd(const void* pointer) {
    int& index = table_[PlaceOf(pointer)];
    if (index < 0) {
      index = static_cast<int>(pointers_.size());
      pointers_.push_back(pointer);
    }
    return index;
  }
  /// Has what FindOrAdd begins with come to the cache.
  void Fetch(const void* pointer) const { __builtin_prefetch(table_.data() + Home(pointer)); }
  /// The index of a pointer, or -1.
  int Find(const void* pointer) const { return table_.empty() ? -1 : table_[PlaceOf(pointer)]; }

  /// Index i becomes numbers[i]: a permutation.
  void Renumber(const std::vector<int>& numbers, int num_threads) {
    constexpr int kGrain = 1 << 14;
    const std::vector<const void*> before = pointers_;
    Executor(num_threads).For(static_cast<int>(before.size()), kGrain, [&](int begin, int end) {
      for (auto i = At(begin); i < At(end); ++i) {
        pointers_[At(numbers[i])] = before[i];
      }
    });
    Executor(num_threads).For(static_cast<int>(table_.size()), kGrain, [&](int begin, int end) {
      for (auto k = At(begin); k < At(end); ++k) {
        table_[k] = table_[k] < 0 ? -1 : numbers[At(table_[k])];
      }
    });
  }

  std::size_t Bytes() const {
    return table_.capacity() * sizeof(int) + pointers_.capacity() * sizeof(void*);
  }

 private:
  // Where the pointer's index is, or else would be.
  std::size_t PlaceOf(const void* pointer) const {
    std::size_t place = Home(pointer);
    while (table_[place] >= 0 && pointers_[At(table_[place])] != pointer) {
      place = (place + 1) & mask_;
    }
    return place;
  }

  // Fibonacci hashing: the high bits of the product depend on all address bits, also when blocks
  // lie at a regular stride.
  std::size_t Home(const void* pointer) const {
    return static_cast<std::size_t>(
        (reinterpret_cast<std::uintptr_t>(pointer) * UINT64_C(0x9E3779B97F4A7C15)) >> shift_);
  }

  std::vector<int> table_;
  std::vector<const void*> pointers_;
  std::size_t mask_ = 0;
  int shift_ = 0;
};

}  // namespace inceres::internal
