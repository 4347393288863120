#pragma once

#include <memory>
#include <mutex>
#include <unordered_map>
#include <utility>

namespace inceres::internal {

/// What is known of the living objects of a process by address. An entry is made by an object's
/// constructor and ends with its destructor, before the address can be used again.
///
/// Threads: any. Cost: a lock and a hash lookup a call. Entries are destroyed outside the lock: a
/// session is large.
template <typename Object, typename Entry>
class LivingObjects {
 public:
  /// One has been constructed here. Whatever was known of this address is forgotten.
  void Add(const Object* object, std::unique_ptr<Entry> entry) {
    const std::lock_guard<std::mutex> lock(mutex_);
    entries_[object].swap(entry);
  }
  std::unique_ptr<Entry> Take(const Object* object) {
    std::unique_ptr<Entry> taken;
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = entries_.find(object);
    if (found != entries_.end()) {
      taken = std::move(found->second);
      entries_.erase(found);
    }
    return taken;
  }
  /// Null if its constructor has not been seen. Valid as long as the object lives.
  Entry* Find(const Object* object) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = entries_.find(object);
    return found == entries_.end() ? nullptr : found->second.get();
  }
  int size() const {
    const std::lock_guard<std::mutex> lock(mutex_);
    return static_cast<int>(entries_.size());
  }

 private:
  mutable std::mutex mutex_;
  std::unordered_map<const Object*, std::unique_ptr<Entry>> entries_;
};

}  // namespace inceres::internal
