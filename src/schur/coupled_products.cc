#include "schur/coupled_products.h"

#include <algorithm>
#include <cstddef>
#include <functional>

#include "linear/small_cholesky.h"

namespace inceres::internal {

// W P̃⁻¹ Wᵀ v from the Jacobians, with P̃ = P + Λ_l (docs/algorithms.md, "Schur complement"): what
// S has less than C, for conjugate gradients on an S that is not formed, and for b where Y is not
// kept. Neither S nor Y is needed. Memory's bandwidth is the limit, so J is read once: the way back
// to the frames of a landmark, y_c += J_cᵀ J_l u, follows while its rows are in the cache.
//
// Landmarks share frames, and tasks must not add to the same y. So landmarks are split into parts,
// each with a y of its own, which are summed in their order at the end. How many there are depends
// on the problem and never on the threads: that makes the sums the same for any number of these.

namespace {

constexpr int kFrameTask = 64;
// More parts than any machine has threads for would only be more to sum.
constexpr int kMaxParts = 64;
// Doubles of J for each of a part's y, which is set to zero, written and read again: so few parts
// that these take some hundredths of the time to read J.
constexpr std::int64_t kJacobianShare = 100;

// One part for a problem that is small next to its frames.
int NumParts(const Evaluator& evaluator, int num_landmarks, int frame_entries) {
  std::int64_t size = 0;
  for (const Linearization& family : evaluator.families()) {
    size += std::int64_t{family.num_factors} * FactorSize(family);
  }
  const std::int64_t most = std::min(kMaxParts, std::max(num_landmarks, 1));
  return static_cast<int>(
      std::clamp(size / (kJacobianShare * std::max(frame_entries, 1)), std::int64_t{1}, most));
}

int FrameEntries(const Layout& layout) {
  return layout.quad_offset[static_cast<std::size_t>(layout.num_frames)] * kQuad;
}

}  // namespace

CoupledProducts::CoupledProducts(const Evaluator& evaluator, const LandmarkIncidences& incidences)
    : evaluator_(evaluator),
      incidences_(incidences),
      kernels_(BestKernels()),
      frame_entries_(FrameEntries(evaluator.layout())),
      num_parts_(NumParts(evaluator, incidences.num_landmarks(), frame_entries_)) {
}

// y += the sums of the parts, entry by entry in the order of the parts.
void CoupledProducts::AddParts(double* y) const {
  evaluator_.executor().For(frame_entries_ / kQuad, kFrameTask, [&](int begin_quad, int end_quad) {
    const std::ptrdiff_t begin = std::ptrdiff_t{begin_quad} * kQuad;
    const std::ptrdiff_t end = std::ptrdiff_t{end_quad} * kQuad;
    for (int part = 1; part < num_parts_; ++part) {
      const double* sum = parts_.data() + std::ptrdiff_t{part - 1} * frame_entries_;
      std::transform(sum + begin, sum + end, y + begin, y + begin, std::plus<>());
    }
  });
}

template <typename Visit>
void CoupledProducts::AddInParts(double* y, const Visit& visit) {
  // Who never asks for a product has no memory for it.
  if (num_parts_ > 1 && parts_.size() == 0) {
    parts_ = ZeroedArray(static_cast<std::size_t>(num_parts_ - 1) * frame_entries_);
  }
  const std::int64_t num_landmarks = incidences_.num_landmarks();
  evaluator_.executor().For(num_parts_, 1, [&](int begin, int end) {
    for (int part = begin; part < end; ++part) {
      double* sum = y;
      if (part > 0) {
        sum = parts_.data() + std::ptrdiff_t{part - 1} * frame_entries_;
        std::fill(sum, sum + frame_entries_, 0.0);
      }
      visit(static_cast<int>(num_landmarks * part / num_parts_),
            static_cast<int>(num_landmarks * (part + 1) / num_parts_), sum);
    }
  });
  AddParts(y);
}

void CoupledProducts::Add(const double* v, const double* U_inv, double* y) {
  CoupledLandmarks landmarks;
  landmarks.factors_begin = incidences_.factors_begin.data();
  landmarks.factors = incidences_.factors.data();
  landmarks.sizes = incidences_.sizes.data();
  landmarks.U_inv = U_inv;
  landmarks.U_inv_stride = std::ptrdiff_t{incidences_.largest_size} * kQuad;
  AddInParts(y, [&](int begin, int end, double* sum) {
    kernels_.add_coupled(landmarks, begin, end, v, sum);
  });
}

void CoupledProducts::Subtract(const double* z, const double* U_inv, double* y) {
  const std::ptrdiff_t stride = std::ptrdiff_t{incidences_.largest_size} * kQuad;
  AddInParts(y, [&](int begin, int end, double* sum) {
    for (int l = begin; l < end; ++l) {
      double u[kQuad] = {};
      MultiplyLowerTransposed(incidences_.sizes[l], U_inv + l * stride,
                              z + static_cast<std::ptrdiff_t>(l) * kQuad, u);
      // The sign goes into u, since what follows adds.
      std::transform(u, u + kQuad, u, std::negate<>());
      for (int k = incidences_.factors_begin[l]; k < incidences_.factors_begin[l + 1]; ++k) {
        kernels_.add_coupling(incidences_.factors[k], u, sum);
      }
    }
  });
}

std::int64_t CoupledProducts::Bytes() const {
  return static_cast<std::int64_t>(parts_.size() * sizeof(double));
}

}  // namespace inceres::internal
