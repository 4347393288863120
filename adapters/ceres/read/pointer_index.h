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
    int bits = 4;
    while ((std::size_t{1} << bits) < 2 * pointers.size()) {
      ++bits;
    }
    shift_ = 64 - bits;
    mask_ = (std::size_t{1} << bits) - 1;
    entries_.assign(mask_ + 1, Entry{});
    for (std::size_t i = 0; i < pointers.size(); ++i) {
      std::size_t place = Home(pointers[i]);
      while (entries_[place].pointer != nullptr) {
        place = (place + 1) & mask_;
      }
      entries_[place] = {pointers[i], static_cast<int>(i)};
    }
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
