#pragma once

#include <cstddef>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"

namespace inceres {

/// A prior on the leading coordinates of one variable, each with its own standard deviation:
///
///     residual_k = sqrt_information_k · (x_k − mean_k),   k < size         (size rows)
///
/// Linear in the variable's own coordinates, so it suits vectors: points, inverse depths, BAL
/// cameras. Fails to evaluate where a residual is not finite.
///
/// Cost: one multiplication a row; allocates nothing in Evaluate (maps that are neither identity
/// nor selection cost a product and a small scratch). Threads: as FactorFamily; Add is for one
/// writer.
class INCERES_EXPORT DiagonalPriorFamily final : public FactorFamily {
 public:
  /// What the prior says of each coordinate.
  struct Measurement {
    std::vector<double> mean;              ///< size entries
    std::vector<double> sqrt_information;  ///< size entries: 1 / standard deviation
  };

  /// A prior on all of a Euclidean variable with `size` coordinates.
  explicit DiagonalPriorFamily(int size) : DiagonalPriorFamily(size, size, size) {}
  /// A prior on the first `size` of `ambient_size` coordinates of a variable with that tangent
  /// size, for example (6, 9, 9) on the pose of a BAL camera, or (6, 9, 6) if a SubsetManifold
  /// holds its intrinsics. Requires size ≤ ambient_size.
  DiagonalPriorFamily(int size, int ambient_size, int tangent_size)
      : FactorFamily(size, {{ambient_size, tangent_size}}) {}

  /// Requires vectors of the family's size.
  void Add(const Measurement& measurement) { Place(size(), measurement); }
  /// Overwrites the measurement at `index`, or appends it if index == size(). Requires vectors of
  /// the family's size.
  void Place(int index, const Measurement& measurement);
  /// `size` entries each, of the prior at `index`.
  const double* mean(int index) const { return means_.data() + Offset(index); }
  /// The square root of the information of the prior at an index.
  const double* sqrt_information(int index) const {
    return sqrt_information_.data() + Offset(index);
  }

  int size() const override { return static_cast<int>(means_.size()) / residual_size(); }
  const char* Name() const override { return "diagonal prior"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  std::size_t Offset(int index) const {
    return static_cast<std::size_t>(index) * static_cast<std::size_t>(residual_size());
  }
  void WriteJacobian(const double* sqrt_information, const TangentMap& map, double* J,
                     int row_stride) const;

  std::vector<double> means_;  // factor-major, residual_size() each
  std::vector<double> sqrt_information_;
};

}  // namespace inceres
