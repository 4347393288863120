#include <algorithm>
#include <cmath>

#include "inceres/factors/gauge.h"
#include "inceres/problem/rotation.h"

// The residual is w (‖c_b − c_a‖ − d). Its gradient with respect to c_b is w times the unit vector
// n from a to b, that with respect to c_a is −w n; the chain rule through c(x) does the rest. For a
// pose or a planar pose the center is among the values. For a BAL camera, which stores
// camera_from_world, it is c = −Exp(w)ᵀ t, and depends on the rotation too.

namespace inceres {
namespace {

// Values and degrees of freedom of a kind. HoldGauge looks for variables of the same sizes.
FactorFamily::Slot SlotOf(CenterKind kind) {
  switch (kind) {
    case CenterKind::kPose:
      return {7, 6};
    case CenterKind::kBalCamera:
      return {9, 9};
    case CenterKind::kPlanarPose:
      break;
  }
  return {3, 3};
}

// c = Exp(−w) v with v = −t.
struct BalCenter {
  explicit BalCenter(const double* camera) {
    // Exp(w)ᵀ = Exp(−w): the transpose is the rotation by −w, and no matrix is transposed.
    const double w[3] = {-camera[0], -camera[1], -camera[2]};
    angle = CoefficientsOfAngle(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    RotationPolynomial(w, angle.sinc, angle.cosc, R_inv);
    const double v[3] = {-camera[3], -camera[4], -camera[5]};
    MultiplyMatrixVector(R_inv, v, c);
  }

  RotationCoefficients angle;
  double R_inv[9];
  double c[3];
};

// J (1 × ambient) = g ∂c/∂x of a row vector g.
void WriteRow(CenterKind kind, const double* x, const double g[3], int ambient_size, double* J) {
  // The values that the center does not depend on: rotation of a pose, intrinsics of a camera.
  std::fill_n(J, ambient_size, 0.0);
  if (kind != CenterKind::kBalCamera) {
    std::copy_n(g, kind == CenterKind::kPose ? 3 : 2, J);
    return;
  }
  const BalCenter center(x);
  for (int k = 0; k < 3; ++k) {  // ∂c/∂t = −R⁻¹
    J[3 + k] = -(g[0] * center.R_inv[k] + g[1] * center.R_inv[3 + k] + g[2] * center.R_inv[6 + k]);
  }
  // With u = −w: ∂(Exp(u) v)/∂u = −[c]× J_l(u), so ∂c/∂w = [c]× J_l(u), and g [c]× = (g × c)ᵀ.
  double gc[3];
  Cross(g, center.c, gc);
  // The coefficients depend on the angle alone, which u and w share.
  const double u[3] = {-x[0], -x[1], -x[2]};
  double J_l[9];
  RotationPolynomial(u, center.angle.cosc, center.angle.sinq, J_l);
  for (int k = 0; k < 3; ++k) {
    J[k] = gc[0] * J_l[k] + gc[1] * J_l[3 + k] + gc[2] * J_l[6 + k];
  }
}

}  // namespace

void CenterOf(CenterKind kind, const double* values, double center[3]) {
  if (kind == CenterKind::kBalCamera) {
    std::copy_n(BalCenter(values).c, 3, center);
    return;
  }
  std::copy_n(values, kind == CenterKind::kPose ? 3 : 2, center);
  if (kind == CenterKind::kPlanarPose) {
    center[2] = 0.0;
  }
}

CenterDistanceFamily::CenterDistanceFamily(CenterKind kind)
    : MeasuredFamily(1, {SlotOf(kind), SlotOf(kind)}), kind_(kind) {
}

bool CenterDistanceFamily::EvaluateOne(int i, const double* const* parameters, double* residuals,
                                       double** jacobians) const {
  const Measurement& measured = measurement(i);
  double a[3], b[3];
  CenterOf(kind_, parameters[0], a);
  CenterOf(kind_, parameters[1], b);
  const double apart[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
  // hypot neither overflows nor underflows, so distances are right at any scale of the world.
  const double distance = std::hypot(apart[0], apart[1], apart[2]);
  // Negated, so that NaN fails. Where the centers coincide, the direction and with it the gradient
  // are not defined.
  if (!(distance > 0.0)) {
    return false;
  }
  residuals[0] = measured.sqrt_information * (distance - measured.distance);
  for (int s = 0; s < 2 && jacobians != nullptr; ++s) {
    if (jacobians[s] != nullptr) {
      // The unit vector apart / distance, with the weight: the sign is that of a or b in c_b − c_a.
      const double scale = (s == 0 ? -1.0 : 1.0) * measured.sqrt_information / distance;
      const double g[3] = {scale * apart[0], scale * apart[1], scale * apart[2]};
      WriteRow(kind_, parameters[s], g, slot(s).ambient_size, jacobians[s]);
    }
  }
  return true;
}

}  // namespace inceres
