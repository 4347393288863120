#include "base/executor.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

namespace inceres::internal {

struct Executor::Arena {
  explicit Arena(int num_threads) : arena(num_threads) {}
  tbb::task_arena arena;
};

Executor::Executor(int num_threads) : num_threads_(num_threads) {
  if (num_threads_ > 1) {
    arena_ = std::make_unique<Arena>(num_threads_);
  }
}

Executor::~Executor() = default;

void Executor::RunParallel(int count, int grain, Callback callback, const void* context) const {
  void* mutable_context = const_cast<void*>(context);
  arena_->arena.execute([&] {
    tbb::parallel_for(tbb::blocked_range<int>(0, count, grain),
                      [&](const tbb::blocked_range<int>& range) { callback(mutable_context, range.begin(), range.end()); });
  });
}

}  // namespace inceres::internal
