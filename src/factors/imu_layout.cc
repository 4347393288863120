#include "factors/imu_layout.h"

// Where conventions put things. Inside, errors have one order, (φ, v, p, b_g, b_a), and one side,
// the right; PartMap takes them to the rows and the side that a user wants. A convention is thus a
// permutation and a rotation of one block, C, and a covariance goes along as C Σ Cᵀ: the
// integration knows of no convention but those that change numbers (noise, walks, midpoint or
// Euler).

namespace inceres::internal {

ImuLayout LayoutOf(const ImuConventions& conventions) {
  ImuLayout layout = {};
  for (int k = 0; k < 5; ++k) {
    // In the order of the enumeration ImuPart, which indexes them.
    int* const places[] = {&layout.rotation, &layout.position, &layout.velocity, &layout.gyr_bias,
                           &layout.acc_bias};
    *places[static_cast<int>(conventions.residual_order[k])] = 3 * k;
  }
  // Velocity is first in every convention; the two biases share columns 3 to 8.
  const bool gyr_first = conventions.bias_order == ImuConventions::BiasOrder::kGyrFirst;
  layout.gyr_column = gyr_first ? 3 : 6;
  layout.acc_column = gyr_first ? 6 : 3;
  return layout;
}

// Of a state: the pose's tangent (δp, φ), then the nine values of the speed-bias as they stand in
// the variable. The order of residuals does not matter here.
ImuLayout StateLayoutOf(const ImuConventions& conventions) {
  ImuLayout layout = LayoutOf(conventions);
  layout.position = 0;
  layout.rotation = 3;
  layout.velocity = 6;
  layout.gyr_bias = 6 + layout.gyr_column;
  layout.acc_bias = 6 + layout.acc_column;
  return layout;
}

Matrix<15, 15> PartMap(const ImuLayout& rows, const Matrix3& R) {
  Matrix<15, 15> C = Matrix<15, 15>::Zero();
  // R is the identity on the right. On the left, Exp(R φ) R = R Exp(φ): the error stands in the
  // other frame.
  C.block<3, 3>(rows.rotation, kDeltaPhi) = R;
  C.block<3, 3>(rows.velocity, kDeltaV).setIdentity();
  C.block<3, 3>(rows.position, kDeltaP).setIdentity();
  C.block<3, 3>(rows.gyr_bias, kDeltaGyrBias).setIdentity();
  C.block<3, 3>(rows.acc_bias, kDeltaAccBias).setIdentity();
  return C;
}

}  // namespace inceres::internal
