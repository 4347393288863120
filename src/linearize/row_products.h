#pragma once

#include <vector>

#include "linearize/evaluator.h"

namespace inceres::internal {

/// −(Jv)ᵀ(f + Jv/2) and ‖Jv‖² for packed tangent vectors v: a pass over the Jacobians each, summed
/// over fixed chunks. Allocates nothing from the second time on.
class JacobianProduct {
 public:
  explicit JacobianProduct(const Evaluator& evaluator) : evaluator_(evaluator) {}

  RowProducts Multiply(const double* v);

 private:
  const Evaluator& evaluator_;
  AlignedVector<double> padded_;
  std::vector<RowProducts> partial_;
};

/// The same, once.
inline RowProducts MultiplyJacobian(const Evaluator& evaluator, const double* v) {
  return JacobianProduct(evaluator).Multiply(v);
}

}  // namespace inceres::internal
