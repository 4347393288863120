#pragma once

#include <functional>

#include "inceres/export.h"

namespace inceres::internal {

/// Executor::For for libraries beside the core, which do not see what that calls: body(begin, end)
/// on ranges that cover [0, count) once, of `grain` or more, on up to num_threads threads. For
/// tasks of many microseconds. What a body throws passes through.
INCERES_EXPORT void ParallelFor(int num_threads, int count, int grain,
                                const std::function<void(int begin, int end)>& body);

/// The same of anything that can be called so. What one thread does it does at once, without a
/// std::function, which would ask for memory.
template <typename Body>
void ParallelFor(int num_threads, int count, int grain, const Body& body) {
  if (num_threads > 1 && count > grain) {
    ParallelFor(num_threads, count, grain,
                std::function<void(int begin, int end)>(std::cref(body)));
  } else if (count > 0) {
    body(0, count);
  }
}

/// So many threads, in the place of an Executor.
class Threads {
 public:
  explicit Threads(int num_threads) : num_threads_(num_threads) {}

  int num_threads() const { return num_threads_; }
  template <typename Body>
  void For(int count, int grain, const Body& body) const {
    ParallelFor(num_threads_, count, grain, body);
  }

 private:
  int num_threads_;
};

}  // namespace inceres::internal
