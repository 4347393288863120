// Comparisons of one thread with one thread: stock's OpenMP is held there, unless the user decides.
#include "tools/solve/stock_threads.h"

#include <dlfcn.h>

#include <cstdlib>

#include <gtest/gtest.h>

namespace inceres::tools {
namespace {

TEST(StockThreads, AreOneWhereOneIsAskedForAndNobodyHasDecided) {
  const auto levels = reinterpret_cast<int (*)()>(dlsym(RTLD_DEFAULT, "omp_get_max_active_levels"));
  if (levels == nullptr || std::getenv("OMP_MAX_ACTIVE_LEVELS") != nullptr) {
    GTEST_SKIP() << "no OpenMP here, or its threads are chosen already";
  }
  const int before = levels();
  ASSERT_GT(before, 0);
  KeepStockOnItsThreads(2);
  EXPECT_EQ(levels(), before);
  setenv("OMP_MAX_ACTIVE_LEVELS", "1", 1);
  KeepStockOnItsThreads(1);
  EXPECT_EQ(levels(), before);
  unsetenv("OMP_MAX_ACTIVE_LEVELS");
  KeepStockOnItsThreads(1);
  EXPECT_EQ(levels(), 0);
}

}  // namespace
}  // namespace inceres::tools
