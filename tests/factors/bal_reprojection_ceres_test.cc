// The same values and derivatives as the AutoDiff cost function that Ceres users write for BAL.
#include <ceres/autodiff_cost_function.h>
#include <ceres/rotation.h>
#include <gtest/gtest.h>

#include "factors/bal_reference.h"
#include "inceres/factors/bal_reprojection.h"

namespace inceres {
namespace {

struct SnavelyError {
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    T P[3];
    ceres::AngleAxisRotatePoint(camera, point, P);
    P[0] += camera[3];
    P[1] += camera[4];
    P[2] += camera[5];
    const T px = -P[0] / P[2];
    const T py = -P[1] / P[2];
    const T r2 = px * px + py * py;
    const T distortion = 1.0 + r2 * (camera[7] + camera[8] * r2);
    residuals[0] = camera[6] * distortion * px - x;
    residuals[1] = camera[6] * distortion * py - y;
    return true;
  }
  double x;
  double y;
};

TEST(BalReprojectionAgainstCeres, ValuesAndJacobians) {
  const TangentMap camera_map{TangentMap::Kind::kIdentity, 9, 9, nullptr, nullptr};
  const TangentMap point_map{TangentMap::Kind::kIdentity, 3, 3, nullptr, nullptr};
  const TangentMap* const maps[2] = {&camera_map, &point_map};
  int index = 0;
  for (const BalState& state : ThousandBalStates()) {
    ceres::AutoDiffCostFunction<SnavelyError, 2, 9, 3> cost(new SnavelyError{state.x, state.y});
    const double* const parameters[2] = {state.camera, state.point};
    double expected[2], expected_J_c[18], expected_J_p[6];
    double* expected_blocks[2] = {expected_J_c, expected_J_p};
    ASSERT_TRUE(cost.Evaluate(parameters, expected, expected_blocks));

    BalReprojectionFamily family;
    family.Add({state.x, state.y});
    double residuals[2], J_c[18], J_p[6];
    const JacobianView views[2] = {{J_c, 18, 9}, {J_p, 6, 3}};
    ASSERT_FALSE(family.Evaluate({0, 1, parameters, maps, residuals, views}).failed());
    for (int r = 0; r < 2; ++r) {
      ASSERT_NEAR(residuals[r], expected[r], 1e-9);
    }
    // Ceres's own derivative near w = 0 is that of X + w × X, off by terms of first order in w:
    // below 1e-7 there.
    const double* w = state.camera;
    const double angle = std::sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    const double tolerance = angle < 1e-6 ? 1e-9 + angle : 1e-10;
    for (int k = 0; k < 18; ++k) {
      ASSERT_NEAR(J_c[k], expected_J_c[k], tolerance * (1000.0 + std::fabs(expected_J_c[k])))
          << "state " << index << ", entry " << k;
    }
    for (int k = 0; k < 6; ++k) {
      ASSERT_NEAR(J_p[k], expected_J_p[k], tolerance * (1000.0 + std::fabs(expected_J_p[k])))
          << "state " << index << ", entry " << k;
    }
    ++index;
  }
}

}  // namespace
}  // namespace inceres
