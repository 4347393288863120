#include "base/executor.h"

#include <atomic>
#include <chrono>
#include <numeric>
#include <thread>
#include <vector>

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <tbb/parallel_for.h>

#include "support/resident_memory.h"

namespace inceres::internal {
namespace {

constexpr int kCount = 20000;

// y[i] = x[n − 1 − i] + 1, range by range: every task reads what other tasks of the call before
// wrote.
void ReverseAndIncrement(const Executor& executor, int grain, const std::vector<int>& x,
                         std::vector<int>* y) {
  executor.For(kCount, grain, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      (*y)[static_cast<std::size_t>(i)] = x[static_cast<std::size_t>(kCount - 1 - i)] + 1;
    }
  });
}

class ExecutorThreads : public testing::TestWithParam<int> {};

TEST_P(ExecutorThreads, CoverEveryIndexOnce) {
  const Executor executor(GetParam());
  EXPECT_EQ(executor.num_threads(), GetParam());
  for (const int count : {1, 2, 7, 64, 1000}) {
    for (const int grain : {1, 3, 64, 2000}) {
      std::vector<std::atomic<int>> visits(static_cast<std::size_t>(count));
      executor.For(count, grain, [&](int begin, int end) {
        for (int i = begin; i < end; ++i) {
          ++visits[static_cast<std::size_t>(i)];
        }
      });
      for (const std::atomic<int>& visit : visits) {
        ASSERT_EQ(visit, 1) << "count " << count << ", grain " << grain;
      }
    }
  }
}

TEST_P(ExecutorThreads, NeverCallTheBodyForNothing) {
  const Executor executor(GetParam());
  int calls = 0;
  executor.For(0, 1, [&](int, int) { ++calls; });
  EXPECT_EQ(calls, 0);
}

TEST_P(ExecutorThreads, SeeWhatTheCallBeforeWrote) {
  const Executor executor(GetParam());
  std::vector<int> x(kCount), y(kCount);
  std::iota(x.begin(), x.end(), 0);
  for (int round = 0; round < 50; ++round) {
    ReverseAndIncrement(executor, 100, x, &y);
    x.swap(y);
  }
  // An even number of reversals and fifty increments; the caller reads without any synchronization
  // of its own.
  for (int i = 0; i < kCount; ++i) {
    ASSERT_EQ(x[static_cast<std::size_t>(i)], i + 50);
  }
}

TEST_P(ExecutorThreads, DoNotMixTwoSolvesAtTheSameTime) {
  const auto work = [](std::vector<int>* x) {
    const Executor executor(GetParam());
    std::vector<int> y(x->size());
    for (int round = 0; round < 20; ++round) {
      ReverseAndIncrement(executor, 100, *x, &y);
      x->swap(y);
    }
  };
  std::vector<int> first(kCount, 0), second(kCount, 1000);
  std::thread other(work, &first);
  work(&second);
  other.join();
  EXPECT_EQ(first, std::vector<int>(kCount, 20));
  EXPECT_EQ(second, std::vector<int>(kCount, 1020));
}

INSTANTIATE_TEST_SUITE_P(Counts, ExecutorThreads, testing::Values(1, 2, 4));

// A body that waits in oneTBB itself, as a user's function may, is not entered again meanwhile.
TEST(Executor, ABodyThatWaitsIsNotEnteredAgainOnItsThread) {
  const Executor executor(2);
  std::atomic<int> num_entered_again{0};
  // Without captures: the thread sanitizer does not see how oneTBB hands a closure of the body's
  // own to another thread.
  static std::atomic<int> sum{0};
  sum = 0;
  for (int round = 0; round < 20; ++round) {
    executor.For(200, 1, [&](int begin, int end) {
      thread_local int depth = 0;
      num_entered_again += depth > 0 ? 1 : 0;
      ++depth;
      tbb::parallel_for(0, 20 * (end - begin), [](int) { ++sum; });
      --depth;
    });
  }
  EXPECT_EQ(num_entered_again, 0);
  EXPECT_EQ(sum, 20 * 20 * 200);
}

int SumInParallel(const Executor& executor) {
  std::atomic<int> sum{0};
  executor.For(100, 1, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      sum += i;
    }
  });
  return sum;
}

// As a cost function does that solves another problem. It waits while every thread of the call
// around it does the same.
TEST(Executor, ATaskMayMakeAParallelCallAndWaitForAThreadThatDoes) {
  const Executor executor(2);
  std::atomic<int> num_inside{0}, num_right{0};
  executor.For(2, 1, [&](int begin, int end) {
    for (int i = begin; i < end; ++i) {
      ++num_inside;
      for (int wait = 0; wait < 100 && num_inside < 2; ++wait) {  // there may be one processor only
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
      num_right += SumInParallel(executor) == 4950 ? 1 : 0;
      std::thread([&] { num_right += SumInParallel(Executor(2)) == 4950 ? 1 : 0; }).join();
    }
  });
  EXPECT_EQ(num_right, 4);
}

TEST(Executor, NoMoreThreadsThanAskedForEachOfTwoCalls) {
  std::vector<std::thread> callers;
  std::atomic<int> most{0};
  for (int caller = 0; caller < 4; ++caller) {
    callers.emplace_back([&] {
      const Executor executor(2);
      for (int round = 0; round < 50; ++round) {
        std::atomic<int> num_inside{0};
        executor.For(20, 1, [&](int, int) {
          const int inside = ++num_inside;
          for (int seen = most; inside > seen && !most.compare_exchange_weak(seen, inside);) {
          }
          std::this_thread::yield();
          --num_inside;
        });
      }
    });
  }
  for (std::thread& caller : callers) {
    caller.join();
  }
  EXPECT_LE(most, 2);
}

TEST(Executor, AnExceptionOutOfATaskLeavesItReadyForTheNextCall) {
  const Executor executor(2);
  for (int round = 0; round < 600;
       ++round) {  // more than there are arenas, should each throw lose one
    EXPECT_THROW(executor.For(20, 1, [](int, int) { throw 1; }), int);
  }
  EXPECT_EQ(SumInParallel(executor), 4950);
}

TEST(Executor, ThoseThatComeAndGoLoseNoMemory) {
  if (test::kUnderSanitizer || test::ResidentBytes() < 0) {
    GTEST_SKIP() << "memory cannot be measured here";
  }
  long before = 0;
  for (int k = 0; k < 6000; ++k) {
    before = k == 1000 ? test::ResidentBytes() : before;
    ASSERT_EQ(SumInParallel(Executor(2 + k % 2)), 4950);
  }
  EXPECT_LT(test::ResidentBytes() - before, 2 << 20);
}

// None of the parent's other threads is there.
TEST(Executor, WorksInAChildProcess) {
  if (test::kUnderSanitizer) {
    GTEST_SKIP() << "the sanitizer's own threads do not survive";
  }
  const Executor executor(2);
  std::atomic<bool> stop{false};
  std::thread busy([&] {
    while (!stop) {
      SumInParallel(Executor(2));
    }
  });
  ASSERT_EQ(SumInParallel(executor), 4950);
  stop = true;
  busy.join();
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    alarm(60);
    _exit(SumInParallel(executor) == 4950 && SumInParallel(Executor(3)) == 4950 ? 0 : 1);
  }
  int status = -1;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
}

TEST(Executor, OneTaskIsTheCallers) {
  const Executor executor(4);
  std::vector<std::thread::id> callers;
  executor.For(kCount, kCount, [&](int begin, int end) {
    EXPECT_EQ(end - begin, kCount);
    callers.push_back(std::this_thread::get_id());
  });
  EXPECT_EQ(callers, std::vector<std::thread::id>{std::this_thread::get_id()});
}

TEST(Executor, KeepsToTheCallingThreadWhenItHasOne) {
  const Executor executor(1);
  std::vector<std::thread::id> callers;
  executor.For(kCount, 10, [&](int, int) { callers.push_back(std::this_thread::get_id()); });
  for (const std::thread::id caller : callers) {
    EXPECT_EQ(caller, std::this_thread::get_id());
  }
  EXPECT_FALSE(callers.empty());
}

}  // namespace
}  // namespace inceres::internal
