#pragma once

#include <array>
#include <atomic>
#include <mutex>

namespace inceres::internal {

/// Hands the latest of a sequence of values from one writer to any number of readers. Neither waits
/// for the other: there are three buffers, one the writer fills, one the readers copy, and the one
/// between them, which both exchange for their own in one atomic step. Readers wait for each other.
///
///     writer:   fill(*latest.Draft());  latest.Publish();
///     reader:   latest.Read([&](const T& value) { copy = value; });
///
/// T keeps its memory from one round to the next, so that a writer whose values no longer grow
/// allocates nothing once each buffer has been filled.
template <typename T>
class LatestValue {
 public:
  /// The writer's own buffer; what is in it is some earlier value.
  T* Draft() { return &buffers_[static_cast<std::size_t>(draft_)]; }

  /// The draft becomes the latest value.
  void Publish() {
    draft_ = between_.exchange(draft_ | kFresh, std::memory_order_acq_rel) & ~kFresh;
  }

  /// Calls use(const T&) with the latest value, from any thread. False, and no call, if there is
  /// none yet.
  template <typename Use>
  bool Read(Use&& use) {
    const std::lock_guard<std::mutex> lock(readers_);
    if ((between_.load(std::memory_order_relaxed) & kFresh) != 0) {
      shown_ = between_.exchange(shown_, std::memory_order_acq_rel) & ~kFresh;
      has_value_ = true;
    }
    if (has_value_) {
      use(static_cast<const T&>(buffers_[static_cast<std::size_t>(shown_)]));
    }
    return has_value_;
  }

 private:
  static constexpr int kFresh = 4;  // of the index in between_: not seen by a reader yet

  std::array<T, 3> buffers_;
  int draft_ = 0;  // the writer's
  std::atomic<int> between_{1};
  std::mutex readers_;  // guards the rest, among readers
  int shown_ = 2;
  bool has_value_ = false;
};

}  // namespace inceres::internal
