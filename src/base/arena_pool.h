#pragma once

#include <memory>

#include <tbb/task_arena.h>

namespace inceres::internal {

/// An arena of oneTBB for one parallel call: one of the process's that is idle, or a new one, which
/// is kept for later calls when this one ends. oneTBB loses some memory with each arena that is
/// destroyed, so a solver that comes and goes must not have one of its own.
///
/// No two calls are in an arena at once: each has all of its num_threads places for itself, also
/// where a task starts a parallel call, or waits for a thread that does. So there are as many
/// arenas of a size as calls were ever under way at the same time.
///
/// Nothing here is locked, so a process that forks in the middle of a solve leaves no lock held in
/// the child. The arenas are never destroyed, for solves may still run while the process ends.
class LeasedArena {
 public:
  explicit LeasedArena(int num_threads);
  ~LeasedArena();
  LeasedArena(const LeasedArena&) = delete;
  LeasedArena& operator=(const LeasedArena&) = delete;

  tbb::task_arena* operator->() const { return arena_; }

  /// A place of the process's table of arenas.
  struct Place;

 private:
  bool TakeFrom(Place* place, int num_threads);

  Place* place_ = nullptr;                // null if the table is full
  std::unique_ptr<tbb::task_arena> own_;  // then
  tbb::task_arena* arena_ = nullptr;
};

}  // namespace inceres::internal
