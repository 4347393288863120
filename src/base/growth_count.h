#pragma once

#include <cstddef>

namespace inceres::internal {

/// While it lives, what a list's memory grows by is added to a count of bytes: whoever has very
/// many lists need not look at each to tell what they take.
template <typename List>
class GrowthCount {
 public:
  GrowthCount(const List& list, std::size_t* bytes)
      : list_(list), bytes_(*bytes), before_(list.capacity()) {}
  GrowthCount(const GrowthCount&) = delete;
  GrowthCount& operator=(const GrowthCount&) = delete;
  // A list that shrinks wraps around, and the sum is right again.
  ~GrowthCount() { bytes_ += sizeof(typename List::value_type) * (list_.capacity() - before_); }

 private:
  const List& list_;
  std::size_t& bytes_;
  const std::size_t before_;
};

}  // namespace inceres::internal
