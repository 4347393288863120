#include "linearize/kept_products.h"

#include <cstring>

namespace inceres::internal {

// JᵀJ of frozen Jacobians, kept. A linear prior has many rows and a Jacobian that does not change,
// so its products are dear and always the same. The test is equality of all bits of the family's
// Jacobians, after the correction for losses; −0 and 0 differ, which costs a product and nothing
// else.

namespace {

constexpr int kMinRows = 16;  // taller than measurements are, IMU factors included
constexpr int kMaxFactors = 4;

// By size and number alone, of Jacobians that are kept: that a family's Jacobian is frozen is found
// out by comparison.
bool TakesPart(const Linearization& cache) {
  return cache.residual_size >= kMinRows && cache.num_factors > 0 &&
         cache.num_factors <= kMaxFactors && cache.jacobian_values.size() > 0;
}

}  // namespace

KeptProducts::KeptProducts(const Evaluator& evaluator, const FramePlans& plans)
    : evaluator_(evaluator),
      // All products are formed once before they can be kept.
      is_stale_(evaluator.families().size(), 1),
      offsets_(plans.hessian.segments.size(), -1) {
  for (const Linearization& cache : evaluator.families()) {
    if (TakesPart(cache)) {
      families_.push_back(cache.id);
    }
  }
  J_.resize(families_.size());
  std::ptrdiff_t size = 0;
  // One place a segment of the plan, of the size of the block it adds to.
  for (std::size_t block = 0; block < plans.block_row.size() && !families_.empty(); ++block) {
    const int rows = plans.pattern.block_size(plans.block_row[block]);
    const int stride = PadToQuad(plans.pattern.block_size(plans.pattern.columns[block]));
    for (int s = plans.hessian.segments_begin[block]; s < plans.hessian.segments_begin[block + 1];
         ++s) {
      const int family = plans.hessian_sources[plans.hessian.segments[s].source].family;
      if (TakesPart(evaluator.families()[family])) {
        offsets_[s] = size;
        size += static_cast<std::ptrdiff_t>(rows) * stride;
      }
    }
  }
  products_.resize(size);
}

// All factors of a family together: with at most kMaxFactors of them one change is as good as all.
void KeptProducts::Observe() {
  for (std::size_t k = 0; k < families_.size(); ++k) {
    const ZeroedArray& J = evaluator_.families()[families_[k]].jacobian_values;
    const bool same = J_[k].size() == J.size() &&
                      std::memcmp(J_[k].data(), J.data(), J.size() * sizeof(double)) == 0;
    is_stale_[families_[k]] = same ? 0 : 1;
    if (!same) {
      J_[k].assign(J.data(), J.data() + J.size());
    }
  }
}

}  // namespace inceres::internal
