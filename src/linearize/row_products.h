#pragma once

#include <vector>

#include "linearize/evaluator.h"

namespace inceres::internal {

struct LandmarkIncidences;

/// −(Jv)ᵀ(f + Jv/2) and ‖Jv‖² for packed tangent vectors v: a pass over the Jacobians each, summed
/// over fixed chunks. Allocates nothing from the second time on.
class JacobianProduct {
 public:
  explicit JacobianProduct(const Evaluator& evaluator) : evaluator_(evaluator) {}

  /// Jacobians that are not kept are evaluated anew; NaN if they cannot be.
  RowProducts Multiply(const double* v);

  /// The share of a chunk of such Jacobians, the one that is in memory; chunks ascend from 0. Of v
  /// no more is read than frames and the landmarks of the chunk.
  void AddChunk(int chunk, const LandmarkIncidences& incidences, const double* v,
                RowProducts* total);

 private:
  void AddChunk(int chunk, RowProducts* total);
  void AddRows(const Linearization& cache, int begin, int end, RowProducts* total);

  const Evaluator& evaluator_;
  AlignedVector<double> padded_;
  std::vector<RowProducts> partial_;
};

/// The same, once.
inline RowProducts MultiplyJacobian(const Evaluator& evaluator, const double* v) {
  return JacobianProduct(evaluator).Multiply(v);
}

}  // namespace inceres::internal
