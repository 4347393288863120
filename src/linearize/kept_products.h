#pragma once

#include <cstddef>
#include <vector>

#include "base/aligned_vector.h"
#include "linearize/product_plan.h"

namespace inceres::internal {

/// Products JᵀJ that need not be formed again because the Jacobian is the one they were formed
/// from, bit for bit. Marginalization priors are like that: their Jacobian is frozen, they have as
/// many rows as columns, and a window has one or two. Worth its compare for few tall factors only,
/// so only families of those take part.
class KeptProducts {
 public:
  KeptProducts(const Evaluator& evaluator, const FramePlans& plans);

  /// Looks which Jacobians have changed. Before every sum, by one thread. Cost: a pass over the
  /// tall Jacobians.
  void Observe();

  /// Where the product of a segment of the Hessian's plan is kept, its rows padded to quads; null
  /// if it is not. To be formed anew while IsStale.
  double* Find(int segment) {
    return offsets_[segment] < 0 ? nullptr : products_.data() + offsets_[segment];
  }
  bool IsStale(int family) const { return is_stale_[family] != 0; }

 private:
  const Evaluator& evaluator_;
  std::vector<int> families_;   // those that take part
  std::vector<char> is_stale_;  // per family
  // per entry of families_: what the products were formed from
  std::vector<AlignedVector<double>> J_;
  std::vector<std::ptrdiff_t> offsets_;  // per segment, or -1
  AlignedVector<double> products_;
};

}  // namespace inceres::internal
