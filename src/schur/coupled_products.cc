#include "schur/coupled_products.h"

#include <algorithm>
#include <cstddef>

#include "linear/small_cholesky.h"

namespace inceres::internal {

// W P̃⁻¹ Wᵀ v from the Jacobians, with P̃ = P + Λ_l (docs/algorithms.md, "Schur complement"): what
// S has less than C, for conjugate gradients on an S that is not formed, and for b where Y is not
// kept. Neither S nor Y is needed. By landmarks, t = J_l P̃⁻¹ J_lᵀ J_c v, one number for each row
// of J; then, by frames, y += J_cᵀ t.
//
// The t between the two passes is what makes the sums deterministic: in the first each task writes
// the rows of its own landmarks, in the second each frame is summed by one task in the order of its
// factors. Adding to the frames straight from the landmarks would have tasks write to the same
// frame.

namespace {

constexpr int kLandmarkTask = 64;
constexpr int kFrameTask = 4;

// The family that a landmark's factors are of. They do not name it, but point to its Jacobians: a
// search among the families, of which there are few.
int FamilyOf(const Evaluator& evaluator, const LandmarkFactors& factors) {
  const auto& families = evaluator.families();
  const auto owner = std::find_if(families.begin(), families.end(), [&](const auto& cache) {
    return cache.slots.data() == factors.jacobians;
  });
  return static_cast<int>(owner - families.begin());
}

}  // namespace

CoupledProducts::CoupledProducts(const Evaluator& evaluator, const LandmarkIncidences& incidences,
                                 const Hessian& hessian)
    : evaluator_(evaluator), incidences_(incidences), hessian_(hessian), kernels_(BestKernels()) {
}

// Who never asks for a product has no memory for it.
void CoupledProducts::Resize() {
  const auto& families = evaluator_.families();
  if (!t_data_.empty() || families.empty()) {
    return;
  }
  t_.resize(families.size());
  t_data_.resize(families.size());
  for (const LandmarkFactors& factors : incidences_.factors) {
    const auto id = static_cast<std::size_t>(FamilyOf(evaluator_, factors));
    if (t_data_[id] == nullptr) {
      t_[id] = ZeroedArray(static_cast<std::size_t>(families[id].num_factors) *
                           families[id].residual_size);
      t_data_[id] = t_[id].data();
    }
  }
}

void CoupledProducts::Store(int landmark, const double* u) {
  for (int k = incidences_.factors_begin[landmark]; k < incidences_.factors_begin[landmark + 1];
       ++k) {
    const LandmarkFactors& factors = incidences_.factors[k];
    const SlotJacobians& J = factors.jacobians[factors.landmark_slot];
    double* const t = t_[FamilyOf(evaluator_, factors)].data();
    for (int n = 0; n < factors.count; ++n) {
      const std::ptrdiff_t factor = factors.factors[n];
      const double* row = J.data + factor * J.factor_stride;
      double* const out = t + factor * factors.residual_size;
      // Four columns whatever the landmark's size: the padding of J_l, and of u, is zero.
      for (int r = 0; r < factors.residual_size; ++r, row += kQuad) {
        out[r] = (row[0] * u[0] + row[1] * u[1]) + (row[2] * u[2] + row[3] * u[3]);
      }
    }
  }
}

void CoupledProducts::AddTransposed(double* y) const {
  const Layout& layout = evaluator_.layout();
  // A family without landmarks has no t, and adds nothing.
  evaluator_.executor().For(layout.num_frames, kFrameTask, [&](int begin, int end) {
    for (int frame = begin; frame < end; ++frame) {
      hessian_.AddTransposed(t_data_, frame,
                             y + static_cast<std::ptrdiff_t>(layout.quad_offset[frame]) * kQuad);
    }
  });
}

void CoupledProducts::Add(const double* v, const double* U_inv, double* y) {
  Resize();
  evaluator_.executor().For(incidences_.num_landmarks(), kLandmarkTask, [&](int begin, int end) {
    for (int l = begin; l < end; ++l) {
      const int size = incidences_.sizes[l];
      const double* const factor = U_inv + l * hessian_.landmark_stride();
      double w[kQuad] = {}, U_inv_w[kQuad] = {}, u[kQuad] = {};
      for (int k = incidences_.factors_begin[l]; k < incidences_.factors_begin[l + 1]; ++k) {
        // w = Wᵀ v of this landmark, then u = U_invᵀ U_inv w = P̃⁻¹ w.
        kernels_.multiply_coupling(incidences_.factors[k], v, w);
      }
      MultiplyLower(size, factor, w, U_inv_w);
      MultiplyLowerTransposed(size, factor, U_inv_w, u);
      Store(l, u);
    }
  });
  AddTransposed(y);
}

void CoupledProducts::Subtract(const double* z, const double* U_inv, double* y) {
  Resize();
  evaluator_.executor().For(incidences_.num_landmarks(), kLandmarkTask, [&](int begin, int end) {
    for (int l = begin; l < end; ++l) {
      double u[kQuad] = {};
      MultiplyLowerTransposed(incidences_.sizes[l], U_inv + l * hessian_.landmark_stride(),
                              z + static_cast<std::ptrdiff_t>(l) * kQuad, u);
      // The sign goes into u, since the second pass adds.
      std::transform(u, u + kQuad, u, [](double entry) { return -entry; });
      Store(l, u);
    }
  });
  AddTransposed(y);
}

std::int64_t CoupledProducts::Bytes() const {
  std::int64_t bytes = 0;
  for (const ZeroedArray& t : t_) {
    bytes += static_cast<std::int64_t>(t.size() * sizeof(double));
  }
  return bytes;
}

}  // namespace inceres::internal
