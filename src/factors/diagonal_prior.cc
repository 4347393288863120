#include "inceres/factors/diagonal_prior.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "inceres/problem/ambient_family.h"

// The residuals are w_k (x_k − mean_k) on the first coordinates of one variable, linear in the
// ambient values: the Jacobian is diag(w), whatever the values are. Means and weights of all
// factors lie in two flat arrays, factor after factor, so the loop over a batch reads memory in
// order and a prior needs no allocation of its own. What kind of map leads to the tangent space
// decides how diag(w) is written: identity and selection are placed, only a dense map costs a
// product.

namespace inceres {

void DiagonalPriorFamily::Place(int index, const Measurement& measurement) {
  assert(static_cast<int>(measurement.mean.size()) == residual_size());
  assert(static_cast<int>(measurement.sqrt_information.size()) == residual_size());
  if (index < 0 || index > size()) {
    return;  // FactorGraph::Check finds the family too small
  }
  const std::size_t first = static_cast<std::size_t>(index) * measurement.mean.size();
  // At the end: both arrays grow by one factor.
  if (index == size()) {
    means_.resize(first + measurement.mean.size());
    sqrt_information_.resize(means_.size());
  }
  std::copy(measurement.mean.begin(), measurement.mean.end(),
            means_.begin() + static_cast<std::ptrdiff_t>(first));
  std::copy(measurement.sqrt_information.begin(), measurement.sqrt_information.end(),
            sqrt_information_.begin() + static_cast<std::ptrdiff_t>(first));
}

void DiagonalPriorFamily::WriteJacobian(const double* sqrt_information, const TangentMap& map,
                                        double* J, int row_stride) const {
  const int size = residual_size();
  // The only case that allocates: diag(w) in ambient columns, for a product with M.
  if (map.kind == TangentMap::Kind::kDense) {
    std::vector<double> ambient(
        static_cast<std::size_t>(size) * static_cast<std::size_t>(map.ambient_size), 0.0);
    for (int r = 0; r < size; ++r) {
      ambient[r * map.ambient_size + r] = sqrt_information[r];
    }
    ProjectToTangentSpace(map, ambient.data(), size, J, row_stride);
    return;
  }
  for (int r = 0; r < size; ++r) {
    std::fill_n(J + r * row_stride, map.tangent_size, 0.0);
  }
  // Column c of the tangent is ambient column k. Coordinates beyond the prior's size have no row,
  // and coordinates that the manifold holds constant have no column.
  for (int c = 0; c < map.tangent_size; ++c) {
    const int k = map.kind == TangentMap::Kind::kSelection ? map.selection[c] : c;
    if (k < size) {
      J[k * row_stride + c] = sqrt_information[k];
    }
  }
}

EvaluationFailure DiagonalPriorFamily::Evaluate(const FactorBatch& batch) const {
  const int size = residual_size();
  for (int i = batch.begin; i < batch.end; ++i) {
    const double* x = batch.parameters[i];
    const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(i) * size;
    const double* sqrt_information = sqrt_information_.data() + first;
    // The sum is finite only if every residual is. It speaks for the Jacobian too: a weight that is
    // not finite makes its residual infinite or NaN.
    double sum = 0.0;
    for (int r = 0; r < size; ++r) {
      batch.residuals[first + r] =
          sqrt_information[r] * (x[r] - means_[static_cast<std::size_t>(first + r)]);
      sum += batch.residuals[first + r];
    }
    if (!std::isfinite(sum)) {
      return {i, "a residual is not finite"};
    }
    // A constant variable or one that is not asked for has no place to write to.
    if (batch.jacobians != nullptr && batch.tangent_maps[i]->wanted()) {
      const JacobianView& view = batch.jacobians[0];
      WriteJacobian(sqrt_information, *batch.tangent_maps[i], view.data + i * view.factor_stride,
                    view.row_stride);
    }
  }
  return {};
}

}  // namespace inceres
