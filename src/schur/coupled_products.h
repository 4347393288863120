#pragma once

#include <vector>

#include "base/zeroed_array.h"
#include "linearize/hessian.h"

namespace inceres::internal {

/// Products with W P̃⁻¹ Wᵀ, what S has less than C, from the Jacobians: Y, which takes more memory
/// than they do, is not needed for it.
///
///     W P̃⁻¹ Wᵀ v = J_cᵀ t,   t = J_l P̃⁻¹ J_lᵀ J_c v
///
/// Cost: two passes over J, by landmarks and by frames. Memory: a t as long as the residuals, from
/// the first product on. Threads: the evaluator's; not by two at once. The same bits for any number
/// of them.
class CoupledProducts {
 public:
  CoupledProducts(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                  const Hessian& hessian);

  /// y += W P̃⁻¹ Wᵀ v over the frames, padded. P̃⁻¹ = U_invᵀ U_inv: per landmark, rows four apart.
  void Add(const double* v, const double* U_inv, double* y);
  /// y −= W U_invᵀ z over the frames, padded; z has four entries a landmark.
  void Subtract(const double* z, const double* U_inv, double* y);

  std::int64_t Bytes() const;

 private:
  void Resize();
  void Store(int landmark, const double* u);  // t of its factors: J_l u
  void AddTransposed(double* y) const;        // y += J_cᵀ t

  const Evaluator& evaluator_;
  const LandmarkIncidences& incidences_;
  const Hessian& hessian_;
  const Kernels& kernels_;
  std::vector<ZeroedArray> t_;         // per family; empty where it has no landmarks
  std::vector<const double*> t_data_;  // null there
};

}  // namespace inceres::internal
