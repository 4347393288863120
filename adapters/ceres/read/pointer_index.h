#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace inceres::internal {

/// Dense indices of addresses: an open-addressing hash table filled in one go. Cost of a lookup:
/// about one cache line.
class PointerIndex {
 public:
  /// Index i belongs to pointers[i]; the pointers are distinct and not null.
  template <typename T>
  void Build(const std::vector<T*>& pointers) {
    Reserve(pointers.size());
    for (std::size_t i = 0; i < pointers.size(); ++i) {
      FindOrAdd(pointers[i], static_cast<int>(i));
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
    entries_.assign(mask_ + 1, Entry{});
  }
  /// The index of a pointer, not null, which is this one if it was not there.
  int FindOrAdd(const void* pointer, int index) {
    std::size_t place = Home(pointer);
    while (entries_[place].pointer != nullptr && entries_[place].pointer != pointer) {
      place = (place + 1) & mask_;
    }
    if (entries_[place].pointer == nullptr) {
      entries_[place] = {pointer, index};
    }
    return entries_[place].index;
  }

  std::size_t Bytes() const { return entries_.capacity() * sizeof(Entry); }

  /// The index of a pointer, or -1.
  int Find(const void* pointer) const {
    if (entries_.empty()) {
      return -1;
    }
    for (std::size_t place = Home(pointer);; place = (place + 1) & mask_) {
      const Entry& entry = entries_[place];
      if (entry.pointer == pointer || entry.pointer == nullptr) {
        return entry.pointer == pointer ? entry.index : -1;
      }
    }
  }

 private:
  struct Entry {
    const void* pointer = nullptr;
    int index = -1;
  };

  // Fibonacci hashing: the high bits of the product depend on all address bits, also when blocks
  // lie at a regular stride.
  std::size_t Home(const void* pointer) const {
    return static_cast<std::size_t>(
        (reinterpret_cast<std::uintptr_t>(pointer) * UINT64_C(0x9E3779B97F4A7C15)) >> shift_);
  }

  std::vector<Entry> entries_;
  std::size_t mask_ = 0;
  int shift_ = 0;
};

}  // namespace inceres::internal
