#include "schur/coupled_products.h"

#include <algorithm>
#include <cstddef>
#include <functional>
#include <utility>

#include "linear/small_cholesky.h"

namespace inceres::internal {

// S v from the Jacobians, with u = P̃⁻¹ Wᵀ v and P̃ = P + Λ_l (docs/algorithms.md, "Schur
// complement"), for conjugate gradients on an S that is not formed; and b where Y is not kept.
// Neither S nor Y is needed. J_l u is taken off J_c v row by row, as in Ceres's implicit Schur
// complement, and not W u off C v: in directions in which landmarks follow the frames that see them
// both are nearly the same. A difference of rows is as exact as rows are; one of sums, which are
// squares of these, leaves twice as few digits. It shows in the iterations that weak
// preconditioners take. Of b the same holds.
//
// Memory's bandwidth is the limit, so J is read once: the way back to the frames of a landmark
// follows while its rows are in the cache.
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

// Rows of the landmark that has most of them.
std::int64_t MostRows(const LandmarkIncidences& incidences) {
  std::int64_t most = 0;
  for (int l = 0; l < incidences.num_landmarks(); ++l) {
    std::int64_t rows = 0;
    for (int k = incidences.factors_begin[l]; k < incidences.factors_begin[l + 1]; ++k) {
      const LandmarkFactors& factors = incidences.factors[k];
      rows += std::int64_t{factors.count} * factors.residual_size;
    }
    most = std::max(most, rows);
  }
  return most;
}

// Of families in single precision Jᵀf is Evaluator::strip_gradient.
bool AllInDouble(const Evaluator& evaluator) {
  const std::vector<Linearization>& families = evaluator.families();
  return std::none_of(families.begin(), families.end(),
                      [](const Linearization& family) { return family.keeps_singles(); });
}

// The records of a family's factors that have free frames and no free landmark. Landmarks come
// behind the frames in a padded vector.
std::vector<std::int32_t> WithoutLandmarks(const Linearization& family, int frame_entries) {
  std::vector<std::int32_t> result;
  for (int i = 0; i < family.num_factors; ++i) {
    const int record = family.Record(i);
    const std::int32_t* const offsets =
        family.RecordOffsets() + std::ptrdiff_t{record} * family.num_slots;
    const std::int32_t last = *std::max_element(offsets, offsets + family.num_slots);
    if (last >= 0 && last < frame_entries / kQuad) {
      result.push_back(record);
    }
  }
  return result;
}

}  // namespace

CoupledProducts::CoupledProducts(const Evaluator& evaluator, const LandmarkIncidences& incidences)
    : evaluator_(evaluator),
      incidences_(incidences),
      kernels_(BestKernels()),
      frame_entries_(FrameEntries(evaluator.layout())),
      num_parts_(NumParts(evaluator, incidences.num_landmarks(), frame_entries_)),
      takes_residuals_(AllInDouble(evaluator)) {
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
// Part 0 adds to y itself, whatever is in it, and the others to zeros: with one part nothing is
// copied.
void CoupledProducts::AddInParts(double* y, const Visit& visit) {
  // Who never asks for a product has no memory for it.
  if (num_parts_ > 1 && parts_.size() == 0) {
    parts_ = ZeroedArray(static_cast<std::size_t>(num_parts_ - 1) * frame_entries_);
  }
  evaluator_.executor().For(num_parts_, 1, [&](int begin, int end) {
    for (int part = begin; part < end; ++part) {
      double* sum = y;
      if (part > 0) {
        sum = parts_.data() + std::ptrdiff_t{part - 1} * frame_entries_;
        std::fill(sum, sum + frame_entries_, 0.0);
      }
      visit(part, sum);
    }
  });
  AddParts(y);
}

// Of `count` things those of a part.
CoupledProducts::Share CoupledProducts::ShareOf(std::int64_t count, int part) const {
  return {static_cast<int>(count * part / num_parts_),
          static_cast<int>(count * (part + 1) / num_parts_)};
}

// Room and lists that products need, once. A structure that is only factored never comes here.
void CoupledProducts::Prepare() {
  if (row_products_.size() > 0) {
    return;
  }
  most_rows_ = PadToQuad(static_cast<int>(MostRows(incidences_)));
  row_products_ = ZeroedArray(static_cast<std::size_t>(num_parts_) * most_rows_ + kQuad);
  for (const Linearization& family : evaluator_.families()) {
    if (std::vector<std::int32_t> factors = WithoutLandmarks(family, frame_entries_);
        !factors.empty()) {
      without_landmarks_.push_back({&family, std::move(factors)});
    }
  }
}

// Each part has a range of landmarks, and a range of the factors without one, of every family.
// Landmarks are as many a part, whatever factors they have.
void CoupledProducts::SubtractReduced(const double* v, const double* U_inv, double* y) {
  Prepare();
  CoupledLandmarks landmarks;
  landmarks.factors_begin = incidences_.factors_begin.data();
  landmarks.factors = incidences_.factors.data();
  landmarks.sizes = incidences_.sizes.data();
  landmarks.U_inv = U_inv;
  landmarks.U_inv_stride = std::ptrdiff_t{incidences_.largest_size} * kQuad;
  AddInParts(y, [&](int part, double* sum) {
    const auto [begin, end] = ShareOf(incidences_.num_landmarks(), part);
    kernels_.subtract_reduced(landmarks, begin, end, v, RowsOfPart(part), sum);
    for (const auto& [family, records] : without_landmarks_) {
      const auto [first, last] = ShareOf(static_cast<std::int64_t>(records.size()), part);
      kernels_.subtract_normal(family->Rows(0, 0), records.data() + first, last - first, v, sum);
    }
  });
}

// With u = −U_invᵀ z a factor adds J_cᵀ (J_l u − f): so both terms of b are taken off row by row, f
// and J_l u together.
void CoupledProducts::AddRightHandSide(const double* z, const double* U_inv, double* y) {
  Prepare();
  const std::ptrdiff_t stride = std::ptrdiff_t{incidences_.largest_size} * kQuad;
  AddInParts(y, [&](int part, double* sum) {
    const auto [begin, end] = ShareOf(incidences_.num_landmarks(), part);
    for (int l = begin; l < end; ++l) {
      double u[kQuad] = {};
      MultiplyLowerTransposed(incidences_.sizes[l], U_inv + l * stride,
                              z + static_cast<std::ptrdiff_t>(l) * kQuad, u);
      // The sign goes into u, since what follows adds.
      std::transform(u, u + kQuad, u, std::negate<>());
      for (int k = incidences_.factors_begin[l]; k < incidences_.factors_begin[l + 1]; ++k) {
        const LandmarkFactors& factors = incidences_.factors[k];
        kernels_.add_coupling(factors, u, ResidualsOf(factors, RowsOfPart(part)), sum);
      }
    }
    for (const auto& [family, records] : without_landmarks_) {
      const auto [first, last] = ShareOf(static_cast<std::int64_t>(records.size()), part);
      if (takes_residuals_) {
        kernels_.subtract_transposed(family->Rows(0, 0), records.data() + first, last - first,
                                     family->residuals.data(), sum);
      }
    }
  });
}

// One after the other, in memory that is the part's; null where they are not taken.
const double* CoupledProducts::ResidualsOf(const LandmarkFactors& factors, double* rows) const {
  if (!takes_residuals_) {
    return nullptr;
  }
  const std::ptrdiff_t size = factors.residual_size;
  for (int n = 0; n < factors.count; ++n) {
    std::copy_n(factors.residuals + factors.factors[n] * size, size, rows + n * size);
  }
  return rows;
}

std::int64_t CoupledProducts::Bytes() const {
  return static_cast<std::int64_t>((parts_.size() + row_products_.size()) * sizeof(double));
}

}  // namespace inceres::internal
