#pragma once

#include <type_traits>

#include "inceres/export.h"

namespace inceres::internal {

/// Runs independent tasks on up to num_threads threads of oneTBB, the calling one among them, in an
/// arena that no other call is in. With one thread, or one task, everything runs on the calling
/// thread and oneTBB is never touched. An executor holds nothing, so it costs nothing to make one.
///
/// Callers let each task write its own output, and sum what tasks wrote in groups that do not
/// depend on num_threads: then the result is the same to the last bit for any number of threads.
class Executor {
 public:
  explicit Executor(int num_threads) : num_threads_(num_threads) {}
  Executor(const Executor&) = delete;
  Executor& operator=(const Executor&) = delete;

  int num_threads() const { return num_threads_; }

  /// Calls body(begin, end) on ranges that cover [0, count) once, of about `grain` or more.
  template <typename Body>
  void For(int count, int grain, Body&& body) const {
    if (num_threads_ <= 1 || count <= grain) {
      if (count > 0) {
        body(0, count);
      }
      return;
    }
    using Function = std::remove_reference_t<Body>;
    RunParallel(
        count, grain,
        [](void* context, int begin, int end) { (*static_cast<Function*>(context))(begin, end); },
        &body);
  }

 private:
  using Callback = void (*)(void* context, int begin, int end);

  INCERES_EXPORT void RunParallel(int count, int grain, Callback callback,
                                  const void* context) const;

  int num_threads_;
};

}  // namespace inceres::internal
