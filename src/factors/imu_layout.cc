#include "factors/imu_layout.h"

namespace inceres::internal {

ImuLayout LayoutOf(const ImuConventions& conventions) {
  ImuLayout layout = {};
  for (int k = 0; k < 5; ++k) {
    int* const places[] = {&layout.rotation, &layout.position, &layout.velocity, &layout.gyr_bias,
                           &layout.acc_bias};
    *places[static_cast<int>(conventions.residual_order[k])] = 3 * k;
  }
  const bool gyr_first = conventions.bias_order == ImuConventions::BiasOrder::kGyrFirst;
  layout.gyr_column = gyr_first ? 3 : 6;
  layout.acc_column = gyr_first ? 6 : 3;
  return layout;
}

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
  C.block<3, 3>(rows.rotation, kDeltaPhi) = R;
  C.block<3, 3>(rows.velocity, kDeltaV).setIdentity();
  C.block<3, 3>(rows.position, kDeltaP).setIdentity();
  C.block<3, 3>(rows.gyr_bias, kDeltaGyrBias).setIdentity();
  C.block<3, 3>(rows.acc_bias, kDeltaAccBias).setIdentity();
  return C;
}

}  // namespace inceres::internal
