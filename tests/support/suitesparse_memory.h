#pragma once

#include <dlfcn.h>

#include <cstddef>

namespace inceres::test {

/// The memory that AMD and CHOLMOD get, from all solvers of this process: Deny() makes every
/// further allocation fail, until Grant() or the end of this object.
class SuiteSparseMemory {
 public:
  SuiteSparseMemory()
      : current_(static_cast<Functions*>(dlsym(RTLD_DEFAULT, "SuiteSparse_config"))) {
    if (current_ != nullptr) {
      usual_ = *current_;
    }
  }
  ~SuiteSparseMemory() { Grant(); }
  SuiteSparseMemory(const SuiteSparseMemory&) = delete;
  SuiteSparseMemory& operator=(const SuiteSparseMemory&) = delete;

  /// False where SuiteSparse keeps its functions to itself, as from 7 on.
  bool IsReachable() const { return current_ != nullptr; }

  void Deny() {
    *current_ = {[](std::size_t) -> void* { return nullptr; },
                 [](std::size_t, std::size_t) -> void* { return nullptr; },
                 [](void*, std::size_t) -> void* { return nullptr; }};
  }
  void Grant() {
    if (current_ != nullptr) {
      *current_ = usual_;
    }
  }

 private:
  /// The beginning of SuiteSparse_config_struct in SuiteSparse_config.h.
  struct Functions {
    void* (*malloc)(std::size_t);
    void* (*calloc)(std::size_t, std::size_t);
    void* (*realloc)(void*, std::size_t);
  };
  Functions* current_;
  Functions usual_ = {};
};

}  // namespace inceres::test
