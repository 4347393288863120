#include "trust_region/preconditioner.h"

#include <string>
#include <utility>

namespace inceres::internal {

// Block Jacobi. Blocks are read where C or S has them; their inverses are made for each damping,
// since Λ_c is added before.

BlockPreconditioner::BlockPreconditioner(const std::vector<int>& offsets,
                                         std::vector<const double*> blocks,
                                         const Executor& executor)
    : offsets_(offsets), blocks_(std::move(blocks)), executor_(executor) {
}

// A block without a factor is an invalid step, named by its frame.
Status BlockPreconditioner::Prepare(const double* damping) {
  const int singular = inverses_.Invert(offsets_, blocks_, damping, executor_);
  return singular < 0 ? Status::Ok()
                      : Status::Error(StatusCode::kSingular,
                                      "the preconditioner is not positive definite at frame " +
                                          std::to_string(singular));
}

}  // namespace inceres::internal
