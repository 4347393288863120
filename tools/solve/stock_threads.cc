#include "tools/solve/stock_threads.h"

#include <dlfcn.h>

#include <cstdlib>

namespace inceres::tools {

// The variable is read when the OpenMP library is loaded, before main. Its function is looked up,
// for it is SuiteSparse that is linked to it, if anything is.
void KeepStockOnItsThreads(int num_threads) {
  if (num_threads != 1 || std::getenv("OMP_MAX_ACTIVE_LEVELS") != nullptr) {
    return;
  }
  if (void* const found = dlsym(RTLD_DEFAULT, "omp_set_max_active_levels")) {
    reinterpret_cast<void (*)(int)>(found)(0);
  }
}

}  // namespace inceres::tools
