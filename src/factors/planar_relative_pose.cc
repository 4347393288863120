#include "inceres/factors/planar_relative_pose.h"

#include <cmath>

#include "factors/whiten.h"
#include "factors/wrap_angle.h"

// An edge of a planar pose graph: e = [R(θ_a)ᵀ (p_b − p_a) − p_m; wrap(θ_b − θ_a − θ_m)], residual
// U e. Angles are plain numbers without a manifold; the wrap makes whole turns between them count
// as nothing. The Jacobians have a closed form in (x, y), the place of b seen from a, since ∂(R(θ)ᵀ
// v)/∂θ is (y, −x).

namespace inceres {

bool PlanarRelativePoseFamily::EvaluateOne(int i, const double* const* parameters,
                                           double* residuals, double** jacobians) const {
  const Measurement& measured = measurement(i);
  const double *a = parameters[0], *b = parameters[1], *U = measured.sqrt_information;
  const double c = std::cos(a[2]), s = std::sin(a[2]);
  const double dx = b[0] - a[0], dy = b[1] - a[1];
  const double x = c * dx + s * dy, y = c * dy - s * dx;  // b's place seen from a
  const double e[3] = {x - measured.motion[0], y - measured.motion[1],
                       // To [−π, π], by the nearest whole number of turns. At half a turn the
                       // residual jumps.
                       internal::WrapAngle(b[2] - a[2] - measured.motion[2])};
  internal::MultiplyUpper<3, 1>(U, e, residuals, 1);
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    // Rows x, y, θ; columns x_a, y_a, θ_a.
    const double J_a[9] = {-c, -s, y, s, -c, -x, 0.0, 0.0, -1.0};
    internal::MultiplyUpper<3, 3>(U, J_a, jacobians[0], 3);
  }
  if (jacobians != nullptr && jacobians[1] != nullptr) {
    // b enters the position without its angle.
    const double J_b[9] = {c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0};
    internal::MultiplyUpper<3, 3>(U, J_b, jacobians[1], 3);
  }
  return true;
}

}  // namespace inceres
