// Values and analytic Jacobians against the reference model, differentiated with complex steps:
// exact to rounding.
#include <algorithm>
#include <complex>

#include <gtest/gtest.h>

#include "factors/bal_reference.h"
#include "inceres/factors/bal_reprojection.h"

namespace inceres {
namespace {

using Complex = std::complex<double>;

// Column k of the 2 × 12 Jacobian of the reference: Im f(x + i h e_k) / h, free of cancellation for
// any h.
void ReferenceColumn(const BalState& state, int k, double column[2]) {
  constexpr double kStep = 1e-40;
  Complex camera[9];
  Complex point[3];
  Complex residual[2];
  std::copy_n(state.camera, 9, camera);
  std::copy_n(state.point, 3, point);
  (k < 9 ? camera[k] : point[k - 9]) += Complex(0.0, kStep);
  ReferenceResidual(camera, point, state.x, state.y, residual);
  column[0] = residual[0].imag() / kStep;
  column[1] = residual[1].imag() / kStep;
}

TEST(BalReprojectionJacobian, AgreesWithTheReferenceAtAThousandStates) {
  const std::vector<BalState> states = ThousandBalStates();
  BalReprojectionFamily family;
  std::vector<const double*> parameters;
  for (const BalState& state : states) {
    family.Add({state.x, state.y});
    parameters.push_back(state.camera);
    parameters.push_back(state.point);
  }
  const TangentMap camera_map{TangentMap::Kind::kIdentity, 9, 9, nullptr, nullptr};
  const TangentMap point_map{TangentMap::Kind::kIdentity, 3, 3, nullptr, nullptr};
  std::vector<const TangentMap*> maps;
  for (std::size_t i = 0; i < states.size(); ++i) {
    maps.push_back(&camera_map);
    maps.push_back(&point_map);
  }
  std::vector<double> residuals(2 * states.size());
  std::vector<double> J_c(18 * states.size());
  std::vector<double> J_p(6 * states.size());
  const JacobianView views[2] = {{J_c.data(), 18, 9}, {J_p.data(), 6, 3}};
  const int num_factors = static_cast<int>(states.size());
  ASSERT_FALSE(
      family.Evaluate({0, num_factors, parameters.data(), maps.data(), residuals.data(), views})
          .failed());

  for (std::size_t i = 0; i < states.size(); ++i) {
    double expected[2];
    ReferenceResidual(states[i].camera, states[i].point, states[i].x, states[i].y, expected);
    for (std::size_t r = 0; r < 2; ++r) {
      ASSERT_NEAR(residuals[2 * i + r], expected[r], 1e-12 * 1000.0) << "state " << i;
    }
    for (int k = 0; k < 12; ++k) {
      double column[2];
      ReferenceColumn(states[i], k, column);
      for (std::size_t r = 0; r < 2; ++r) {
        const double actual = k < 9 ? J_c[18 * i + 9 * r + static_cast<std::size_t>(k)]
                                    : J_p[6 * i + 3 * r + static_cast<std::size_t>(k - 9)];
        ASSERT_NEAR(actual, column[r], 1e-12 * (1000.0 + std::fabs(column[r])))
            << "state " << i << ", row " << r << ", column " << k;
      }
    }
  }
}

}  // namespace
}  // namespace inceres
