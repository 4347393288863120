// What a plugin does that solves with the shared core on two threads, without the solve.
#include <atomic>
#include <chrono>
#include <thread>

#include "base/executor.h"
#include "inceres/export.h"

// Each task is long enough for the other thread to come and take some.
extern "C" INCERES_EXPORT int CountOnTwoThreads(int count) {
  std::atomic<int> counted{0};
  inceres::internal::Executor(2).For(count, 1, [&counted](int begin, int end) {
    std::this_thread::sleep_for(std::chrono::microseconds(100));
    counted += end - begin;
  });
  return counted;
}
