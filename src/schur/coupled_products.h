#pragma once

#include <cstdint>

#include "base/zeroed_array.h"
#include "linearize/evaluator.h"
#include "linearize/incidences.h"

namespace inceres::internal {

/// Products with W P̃⁻¹ Wᵀ, what S has less than C, from the Jacobians: Y, which takes more memory
/// than they do, is not needed for it.
///
///     W P̃⁻¹ Wᵀ v = Σ_l W_l P̃_l⁻¹ W_lᵀ v,   W_l = J_cᵀ J_l over the factors of landmark l
///
/// Cost: one pass over J. Memory: at most a hundredth of J, from the first product on. Threads: the
/// evaluator's; not by two at once. The same bits for any number of them.
class CoupledProducts {
 public:
  CoupledProducts(const Evaluator& evaluator, const LandmarkIncidences& incidences);

  /// y += W P̃⁻¹ Wᵀ v over the frames, padded. P̃⁻¹ = U_invᵀ U_inv: per landmark, as many rows as
  /// the largest has, four apart.
  void Add(const double* v, const double* U_inv, double* y);
  /// y −= W U_invᵀ z over the frames, padded; z has four entries a landmark.
  void Subtract(const double* z, const double* U_inv, double* y);

  std::int64_t Bytes() const;
  /// From the first product on.
  std::int64_t BytesOfParts() const {
    return static_cast<std::int64_t>(sizeof(double)) * (num_parts_ - 1) * frame_entries_;
  }

 private:
  /// y += Σ of what visit(begin, end, sum) adds to `sum` for the landmarks from begin to end.
  template <typename Visit>
  void AddInParts(double* y, const Visit& visit);
  void AddParts(double* y) const;

  const Evaluator& evaluator_;
  const LandmarkIncidences& incidences_;
  const Kernels& kernels_;
  const int frame_entries_;  // of a padded vector of the frames
  const int num_parts_;
  ZeroedArray parts_;  // a padded vector for each part but the first, which adds to y
};

}  // namespace inceres::internal
