#pragma once

#include <cmath>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/problem/manifolds.h"

namespace inceres {

/// The upper triangular U with UᵀU = information (row-major, size × size, symmetric positive
/// definite; only its upper triangle is read): ‖U r‖² = rᵀ information r, so U whitens a residual.
/// Writes U row-major with zeros below the diagonal. Returns false, U then undefined, if the matrix
/// is not positive definite or not finite. U must not alias information. Allocates nothing. Source:
/// Golub & Van Loan, "Matrix Computations", 4th ed., section 4.2 (Cholesky, outer-product form).
[[nodiscard]] inline bool SqrtInformation(const double* information, int size, double* U) {
  for (int r = 0; r < size; ++r) {
    for (int c = 0; c < size; ++c) {
      double sum = c < r ? 0.0 : information[r * size + c];
      for (int k = 0; c >= r && k < r; ++k) {
        sum -= U[k * size + r] * U[k * size + c];
      }
      if (c == r) {
        if (!(sum > 0.0) || !std::isfinite(sum)) {
          return false;
        }
        U[r * size + r] = std::sqrt(sum);
      } else {
        U[r * size + c] = c < r ? 0.0 : sum / U[r * size + r];
      }
    }
  }
  for (int k = 0; k < size * size; ++k) {
    if (!std::isfinite(U[k])) {
      return false;
    }
  }
  return true;
}

/// Where the pose should be, and how well that is known.
struct PosePriorMeasurement {
  double pose[7] = {0.0, 0.0, 0.0, 0.0,
                    0.0, 0.0, 1.0};  ///< p_0, then R_0 as a unit quaternion x, y, z, w
  double sqrt_information[36] = {};  ///< U, row-major, upper triangular, see SqrtInformation
};

/// A prior on a pose [p(3), q(x, y, z, w)], with analytic Jacobians:
///
///     residual = U [p − p_0; Log(R_0ᵀ R)]   on PoseManifold (R Exp(φ)),
///     residual = U [p − p_0; Log(R R_0ᵀ)]   on LeftPoseManifold (Exp(φ) R)
///
/// (6 rows: meters, then radians; whitened), so that U is the square root of an information matrix
/// in the manifold's own tangent. No other manifold will do. Smooth wherever the rotation residual
/// is below π. Fails to evaluate where a result is not finite.
///
/// Cost: a 6×6 triangular product and one arc tangent a factor, nothing allocated. Threads: as
/// FactorFamily; Add is for one writer. Source: Sola, Deray & Atchuthan, "A micro Lie theory for
/// state estimation in robotics", 2018, appendix B.
class INCERES_EXPORT PosePriorFamily final : public MeasuredFamily<PosePriorMeasurement> {
 public:
  /// On which side the pose is perturbed.
  using Side = Perturbation;

  /// For poses that are perturbed on this side.
  explicit PosePriorFamily(Side side = Side::kRight) : MeasuredFamily(6, {{7, 6}}), side_(side) {}

  /// On which side poses are perturbed.
  Side side() const { return side_; }

  const char* Name() const override { return "pose prior"; }
  SlotSpace Space(int /*s*/) const override {
    return side_ == Side::kLeft ? SlotSpace::kLeftPose : SlotSpace::kPose;
  }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;

 private:
  Side side_;
};

/// What velocity and biases should be, and how well that is known.
struct SpeedBiasPriorMeasurement {
  double speed_bias[9] = {};         ///< x_0
  double sqrt_information[81] = {};  ///< U, row-major, upper triangular, see SqrtInformation
};

/// A prior on a velocity and biases, [v(3), biases(6)], or on anything else with nine Euclidean
/// coordinates:
///
///     residual = U (x − x_0)                                                  (9 rows, whitened)
///
/// A diagonal U is cheaper as DiagonalPriorFamily(9). Fails to evaluate where a residual is not
/// finite.
///
/// Cost: a 9×9 triangular copy a factor, nothing allocated. Threads: as FactorFamily; Add is for
/// one writer.
class INCERES_EXPORT SpeedBiasPriorFamily final : public MeasuredFamily<SpeedBiasPriorMeasurement> {
 public:
  SpeedBiasPriorFamily() : MeasuredFamily(9, {{9, 9}}) {}

  const char* Name() const override { return "speed-bias prior"; }
  SlotSpace Space(int /*s*/) const override { return SlotSpace::kEuclidean; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
};

}  // namespace inceres
