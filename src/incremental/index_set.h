#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace inceres::internal {

/// A set of small indices for marking a part of a large problem: a bitmap under a bitmap of its
/// words that are not zero. Adding costs a few instructions, walking goes in ascending order
/// without sorting and costs n/4096 plus what the set holds.
class IndexSet {
 public:
  /// Makes room for indices < size.
  void Grow(std::size_t size) {
    words_.resize((size + 63) / 64, 0);
    summary_.resize((words_.size() + 63) / 64, 0);
  }

  /// False if it was there already.
  bool Add(std::int32_t index) {
    std::uint64_t& word = words_[Word(index)];
    const std::uint64_t bit = Bit(index);
    const std::uint64_t before = word;
    if ((before & bit) != 0) {
      return false;
    }
    word = before | bit;
    if (before == 0) {
      summary_[Word(index) / 64] |= std::uint64_t{1} << (Word(index) % 64);
    }
    ++count_;
    return true;
  }
  void Remove(std::int32_t index) {
    std::uint64_t& word = words_[Word(index)];
    count_ -= (word & Bit(index)) != 0 ? 1 : 0;
    word &= ~Bit(index);
  }
  bool Has(std::int32_t index) const { return (words_[Word(index)] & Bit(index)) != 0; }
  bool empty() const { return count_ == 0; }
  int count() const { return count_; }

  /// Calls visit(index) in ascending order.
  template <typename Visit>
  void ForEach(Visit&& visit) const {
    for (std::size_t s = 0; s < summary_.size(); ++s) {
      for (std::uint64_t filled = summary_[s]; filled != 0; filled &= filled - 1) {
        const std::size_t w = 64 * s + static_cast<std::size_t>(__builtin_ctzll(filled));
        for (std::uint64_t word = words_[w]; word != 0; word &= word - 1) {
          visit(
              static_cast<std::int32_t>(64 * w + static_cast<std::size_t>(__builtin_ctzll(word))));
        }
      }
    }
  }

  /// The members in ascending order, into a vector whose memory is used again: it gets room for all
  /// indices at once.
  void CopyTo(std::vector<std::int32_t>* indices) const {
    indices->reserve(64 * words_.capacity());
    indices->resize(static_cast<std::size_t>(count_));
    std::int32_t* next = indices->data();
    ForEach([&next](std::int32_t index) { *next++ = index; });
  }

  void Clear() {
    for (std::size_t s = 0; s < summary_.size(); ++s) {
      for (std::uint64_t filled = summary_[s]; filled != 0; filled &= filled - 1) {
        words_[64 * s + static_cast<std::size_t>(__builtin_ctzll(filled))] = 0;
      }
      summary_[s] = 0;
    }
    count_ = 0;
  }

 private:
  static std::size_t Word(std::int32_t index) { return static_cast<std::size_t>(index) / 64; }
  static std::uint64_t Bit(std::int32_t index) {
    return std::uint64_t{1} << (static_cast<std::size_t>(index) % 64);
  }

  std::vector<std::uint64_t> words_;
  std::vector<std::uint64_t> summary_;
  int count_ = 0;
};

}  // namespace inceres::internal
