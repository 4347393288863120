#include "base/arena_pool.h"

#include <atomic>

// Arenas of oneTBB by place in a table that is searched from its begin: the first place whose idle
// arena has the size asked for, or that has none yet, is taken. One atomic integer per place is all
// the synchronization there is: its sign says whether a call is in the arena, its absolute value
// how many threads the arena has, and both change in one exchange.

namespace inceres::internal {

// The state is 0 while the place has no arena, n while its arena of n threads is idle, −n while a
// call is in it.
struct LeasedArena::Place {
  std::atomic<int> state{0};
  tbb::task_arena* arena = nullptr;  // written once, by the first call in it
};

namespace {

// Room for calls at the same time and for numbers of threads. What finds none has an arena for this
// one call.
constexpr int kNumPlaces = 256;

// Constant initialization, trivial destruction: there before the first solve and after the last
// one.
LeasedArena::Place places[kNumPlaces];

}  // namespace

// A scan of 256 integers at worst, once per parallel call. Two calls that want the same place
// settle it by the exchange in TakeFrom; the loser goes on to the next place.
LeasedArena::LeasedArena(int num_threads) {
  for (Place& place : places) {
    if (TakeFrom(&place, num_threads)) {
      return;
    }
  }
  own_ = std::make_unique<tbb::task_arena>(num_threads);
  arena_ = own_.get();
}

// Acquire here pairs with release in the destructor: whoever takes the place next sees the pointer
// to the arena that its first call has written.
bool LeasedArena::TakeFrom(Place* place, int num_threads) {
  int state = place->state.load(std::memory_order_relaxed);
  // Not at once the exchange: it would fetch the cache line for writing of every place passed by.
  if ((state != num_threads && state != 0) ||
      !place->state.compare_exchange_strong(state, -num_threads, std::memory_order_acquire,
                                            std::memory_order_relaxed)) {
    return false;
  }
  place_ = place;
  if (place->arena == nullptr) {
    place->arena = new tbb::task_arena(num_threads);
  }
  arena_ = place->arena;
  return true;
}

// The state is −n as long as the lease holds, and nobody else writes it: a plain store of n gives
// the arena back.
LeasedArena::~LeasedArena() {
  if (place_ != nullptr) {
    place_->state.store(-place_->state.load(std::memory_order_relaxed), std::memory_order_release);
  }
}

}  // namespace inceres::internal
