#pragma once

#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "simd/kernels.h"

namespace inceres::internal {

/// The Jacobians of factors whose weight has become zero, as they are without it: where the weight
/// comes back, nothing needs to be linearized to have them. By factor and slot, in the layout of
/// the slots. Cost: what is parked. Threads: one at a time.
class ParkedJacobians {
 public:
  bool Has(int factor) const { return parked_.count(factor) != 0; }

  /// Takes a copy of the factor's rows, whatever was there before.
  void Park(int factor, const SlotJacobians* slots, int num_slots) {
    std::vector<double>& rows = parked_[factor];
    rows.clear();
    for (int s = 0; s < num_slots; ++s) {
      const double* J = slots[s].data + factor * slots[s].factor_stride;
      rows.insert(rows.end(), J, J + slots[s].factor_stride);
    }
  }

  /// Gives the rows back and forgets them. Requires Has.
  void Fetch(int factor, const SlotJacobians* slots, int num_slots) {
    const auto found = parked_.find(factor);
    const double* row = found->second.data();
    for (int s = 0; s < num_slots; ++s) {
      double* J = slots[s].data + factor * slots[s].factor_stride;
      for (std::ptrdiff_t k = 0; k < slots[s].factor_stride; ++k) {
        J[k] = row[k];
      }
      row += slots[s].factor_stride;
    }
    parked_.erase(found);
  }

  /// What was parked is outdated.
  void Drop(int factor) {
    if (!parked_.empty()) {
      parked_.erase(factor);
    }
  }

  std::int64_t Bytes() const {
    std::size_t bytes = 0;
    for (const auto& [factor, rows] : parked_) {
      bytes += sizeof(std::pair<int, std::vector<double>>) + rows.capacity() * sizeof(double);
    }
    return static_cast<std::int64_t>(bytes);
  }

 private:
  std::unordered_map<int, std::vector<double>> parked_;
};

}  // namespace inceres::internal
