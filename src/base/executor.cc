#include "base/executor.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#if defined(__SANITIZE_THREAD__)
#include <sanitizer/tsan_interface.h>
#endif

#include "base/arena_pool.h"

// Only calls that are worth several threads come here; Executor::For has done the others itself.
// Ranges are cut by oneTBB's automatic partitioner, so which thread runs what differs from call to
// call; that the results do not is the callers' doing, who give each task its own output
// (docs/determinism.md).

namespace inceres::internal {

namespace {

// oneTBB's own synchronization is not compiled with the thread sanitizer; these tell it what
// parallel_for guarantees: what the caller did before happens before every task, and every task
// happens before the call returns.
#if defined(__SANITIZE_THREAD__)
void Acquire(char* token) {
  __tsan_acquire(token);
}
void Release(char* token) {
  __tsan_release(token);
}
#else
void Acquire(char*) {
}
void Release(char*) {
}
#endif

// When a scope ends, by an exception too: what a task throws is the caller's to see.
class AtEnd {
 public:
  AtEnd(void (*tell)(char*), char* token) : tell_(tell), token_(token) {}
  ~AtEnd() { tell_(token_); }
  AtEnd(const AtEnd&) = delete;
  AtEnd& operator=(const AtEnd&) = delete;

 private:
  void (*tell_)(char*);
  char* token_;
};

}  // namespace

void Executor::RunParallel(int count, int grain, Callback callback, const void* context) const {
  // The template that made `context` casts it back to the type of the body, which may be const.
  void* mutable_context = const_cast<void*>(context);
  // Only their addresses are used: tokens of the thread sanitizer.
  char started = 0;
  char finished = 0;
  const LeasedArena arena(num_threads_);
  // Destroyed before the lease ends: the arena is given back last.
  const AtEnd all_finished(Acquire, &finished);
  Release(&started);
  arena->execute([&] {
    tbb::parallel_for(tbb::blocked_range<int>(0, count, grain),
                      [&](const tbb::blocked_range<int>& range) {
                        Acquire(&started);
                        const AtEnd task_finished(Release, &finished);
                        // Isolated: a body that waits in oneTBB itself, as a user's function may,
                        // must not be handed another range of ours meanwhile.
                        tbb::this_task_arena::isolate(
                            [&] { callback(mutable_context, range.begin(), range.end()); });
                      });
  });
}

}  // namespace inceres::internal
