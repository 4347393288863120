#include "base/parallel_for.h"

#include "base/executor.h"

namespace inceres::internal {

void ParallelFor(int num_threads, int count, int grain,
                 const std::function<void(int begin, int end)>& body) {
  Executor(num_threads).For(count, grain, body);
}

}  // namespace inceres::internal
