#pragma once

#include <cstdint>
#include <vector>

#include "base/zeroed_array.h"
#include "inceres/problem/ambient_family.h"

namespace inceres::internal {

/// What calls of cost functions with Jacobians have yielded, for who comes back to the same point:
/// of each factor of a family the values it was called with last, its residuals and its ambient
/// Jacobians. Coordinate descent leaves each variable where its factors were linearized, and the
/// next group, or the next step, begins there.
///
/// Found by comparing values, bit by bit: nobody need say what has moved. Threads: on different
/// factors at a time.
class KeptEvaluations {
 public:
  static bool CanKeep(const FactorFamily& family) { return family.num_slots() <= kMostKeptSlots; }
  /// What one takes.
  static std::int64_t Bytes(const FactorFamily& family, int num_factors);

  /// Requires CanKeep.
  KeptEvaluations(const FactorFamily& family, int num_factors);

  /// Nothing is kept any more.
  void Forget();

  // FetchKept and TakeKept (inceres/problem/ambient_family.h) of its batch.

  bool Fetch(const FactorBatch& batch, int i, double** blocks);
  int Take(const FactorBatch& batch, int i, bool is_new, const double** J);

 private:
  bool IsAt(const double* const* parameters, const double* values) const;
  std::uint32_t Keep(const double* const* parameters, const TangentMap* const* maps,
                     const double* residuals, double* record) const;
  double* Record(int i) const { return records_.data() + i * stride_; }
  std::ptrdiff_t Entry(int i) const { return static_cast<std::ptrdiff_t>(slots_.size()) * i; }

  std::vector<AmbientSlot> slots_;  // their sizes
  int residual_size_;
  int num_values_ = 0;
  std::ptrdiff_t stride_;            // of a record: values, residuals, Jacobians
  std::vector<std::uint32_t> kept_;  // per factor: a bit for each slot whose Jacobian is there
  ZeroedArray records_;
};

}  // namespace inceres::internal
