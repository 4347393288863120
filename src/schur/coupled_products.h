#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/zeroed_array.h"
#include "linearize/evaluator.h"
#include "linearize/incidences.h"

namespace inceres::internal {

/// Products with S = C − W P̃⁻¹ Wᵀ from the Jacobians: Y, which takes more memory than they do, is
/// not needed for it, nor is C.
///
///     S v = Σ J_cᵀ (J_c v − J_l u_l) over all factors,   u_l = P̃_l⁻¹ W_lᵀ v,
///     W_l = Σ J_cᵀ J_l over the factors of landmark l
///
/// Cost: one pass over J. Memory: at most a hundredth of J and a number for each factor without a
/// landmark, from the first product on. Threads: the evaluator's; not by two at once. The same bits
/// for any number of them.
class CoupledProducts {
 public:
  CoupledProducts(const Evaluator& evaluator, const LandmarkIncidences& incidences);

  /// y −= S v over the frames, padded, without their damping. P̃⁻¹ = U_invᵀ U_inv: per landmark, as
  /// many rows as the largest has, four apart.
  void SubtractReduced(const double* v, const double* U_inv, double* y);
  /// y += b = −Σ J_cᵀ (f + J_l U_invᵀ z) over the frames, padded; z has four entries a landmark.
  /// Without the residuals f unless takes_residuals().
  void AddRightHandSide(const double* z, const double* U_inv, double* y);
  /// Whether f is kept beside the Jacobians, in double precision both.
  bool takes_residuals() const { return takes_residuals_; }

  std::int64_t Bytes() const;
  /// From the first product on.
  std::int64_t BytesOfParts() const {
    return static_cast<std::int64_t>(sizeof(double)) * (num_parts_ - 1) * frame_entries_;
  }

 private:
  struct Share {
    int begin;
    int end;
  };
  /// Of a family, by their records.
  struct Factors {
    const Linearization* family;
    std::vector<std::int32_t> records;
  };
  /// y += Σ of what visit(part, sum) adds to `sum` for each part.
  template <typename Visit>
  void AddInParts(double* y, const Visit& visit);
  void AddParts(double* y) const;
  Share ShareOf(std::int64_t count, int part) const;
  void Prepare();
  double* RowsOfPart(int part) { return row_products_.data() + std::ptrdiff_t{part} * most_rows_; }
  const double* ResidualsOf(const LandmarkFactors& factors, double* rows) const;

  const Evaluator& evaluator_;
  const LandmarkIncidences& incidences_;
  const Kernels& kernels_;
  const int frame_entries_;  // of a padded vector of the frames
  const int num_parts_;
  const bool takes_residuals_;
  ZeroedArray parts_;  // a padded vector for each part but the first, which adds to y
  // From the first product on.
  std::ptrdiff_t most_rows_ = 0;  // of a landmark's factors, padded
  ZeroedArray row_products_;      // J_c v of them, or f; per part
  std::vector<Factors> without_landmarks_;
};

}  // namespace inceres::internal
