#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace inceres::fuzz {

/// Memory for objects of up to kBytes that comes back at once: what was freed last is given out
/// next, whatever its type was. A cost function that is deleted and its successor have one address,
/// and so have a loss and the cost function after it.
///
/// Threads: one. The memory itself is never given back, for it may be asked for until the process
/// ends.
class Recycled {
 public:
  static constexpr std::size_t kBytes = 512;

  static void* Take(std::size_t bytes) {
    if (bytes > kBytes) {
      return ::operator new(bytes);
    }
    std::vector<void*>& free = FreeList();
    if (free.empty()) {
      return ::operator new(kBytes);
    }
    void* memory = free.back();
    free.pop_back();
    return memory;
  }

  static void GiveBack(void* memory, std::size_t bytes) {
    if (bytes > kBytes) {
      ::operator delete(memory);
    } else {
      FreeList().push_back(memory);
    }
  }

 private:
  static std::vector<void*>& FreeList() {
    static auto& list = *new std::vector<void*>;
    return list;
  }
};

}  // namespace inceres::fuzz
