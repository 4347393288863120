#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "inceres/problem/factor_family.h"

namespace inceres::internal {

/// U (2×2, row-major) from its three entries.
inline void UnpackUpper(const double packed[3], double U[4]) {
  U[0] = packed[0];
  U[1] = packed[1];
  U[2] = 0.0;
  U[3] = packed[2];
}

/// J = U E, U upper triangular (rows × rows), E rows × columns, both row-major; rows of J are
/// row_stride apart. Returns the sum of the entries of J, which is finite only if all are. J must
/// not alias E.
template <int rows, int columns>
double MultiplyUpper(const double* U, const double* E, double* J, int row_stride) {
  double sum = 0.0;
  for (int r = 0; r < rows; ++r) {
    double row[columns] = {};
    for (int k = r; k < rows; ++k) {
      for (int c = 0; c < columns; ++c) {
        row[c] += U[rows * r + k] * E[columns * k + c];
      }
    }
    for (int c = 0; c < columns; ++c) {
      sum += row[c];
    }
    std::copy_n(row, columns, J + r * row_stride);
  }
  return sum;
}

/// Writes U E of a slot of factor i. Returns the sum of what was written.
template <int rows, int columns>
double WriteSlot(const FactorBatch& batch, int i, int slot, const double* U, const double* E) {
  const JacobianView& view = batch.jacobians[slot];
  return MultiplyUpper<rows, columns>(U, E, view.data + i * view.factor_stride, view.row_stride);
}

/// Writes U e of factor i and then, if Jacobians are asked for, those of the slots that want one:
/// write_slot(slot, map, values) writes one and returns the sum of its entries, as WriteSlot. Null,
/// or what of it is not finite.
template <int rows, typename Write>
const char* WriteFactor(const FactorBatch& batch, int i, int num_slots, const double* U,
                        const double* e, const Write& write_slot) {
  double* const residual = batch.residuals + rows * static_cast<std::ptrdiff_t>(i);
  if (!std::isfinite(MultiplyUpper<rows, 1>(U, e, residual, 1))) {
    return "a residual is not finite";
  }
  double sum = 0.0;
  for (int s = 0; batch.jacobians != nullptr && s < num_slots; ++s) {
    const std::ptrdiff_t index = num_slots * static_cast<std::ptrdiff_t>(i) + s;
    // A constant or unwanted variable has no block to write to; its derivative is not formed.
    if (const TangentMap& map = *batch.tangent_maps[index]; map.wanted()) {
      sum += write_slot(s, map, batch.parameters[index]);
    }
  }
  return std::isfinite(sum) ? nullptr : "a Jacobian entry is not finite";
}

/// evaluate(i) of each factor, up to the first one with a reason to fail: what is not null.
template <typename Evaluate>
EvaluationFailure EvaluateEach(const FactorBatch& batch, const Evaluate& evaluate) {
  for (int i = batch.begin; i < batch.end; ++i) {
    if (const char* reason = evaluate(i)) {
      return {i, reason};
    }
  }
  return {};
}

}  // namespace inceres::internal
