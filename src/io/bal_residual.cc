#include <cmath>

#include "inceres/io/bal.h"

// The reprojection error of a BAL problem, written down once more and independently of the factors
// that are solved (factors/bal_reprojection.h): tools and tests hold the solver's cost against it,
// and need no graph for it.
//
//     P = Exp(a) X + t,   p = −P_xy / P_z,   e = f (1 + k1 r² + k2 r⁴) p − (x, y),   r = ‖p‖
//
// The sum runs in the order of the observations on one thread.

namespace inceres {
namespace {

// Exp(a) X, Rodrigues' formula; the series where sin x / x would lose digits.
// With θ = ‖a‖:
//
//     Exp(a) X = cos θ X + (sin θ / θ) a × X + ((1 − cos θ) / θ²) a (aᵀX)
//
// Below 1e-4 the first term left out of either series is under 1e-18, and 1 − cos θ would have lost
// half of its digits.
void Rotate(const double* a, const double* X, double* result) {
  const double angle2 = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
  const double angle = std::sqrt(angle2);
  const bool small = angle < 1e-4;
  const double sine = small ? 1.0 - angle2 / 6.0 : std::sin(angle) / angle;
  const double versine = small ? 0.5 - angle2 / 24.0 : (1.0 - std::cos(angle)) / angle2;
  const double cross[3] = {a[1] * X[2] - a[2] * X[1], a[2] * X[0] - a[0] * X[2],
                           a[0] * X[1] - a[1] * X[0]};
  const double along = a[0] * X[0] + a[1] * X[1] + a[2] * X[2];
  for (int i = 0; i < 3; ++i) {
    // cos θ = 1 − θ² (1 − cos θ) / θ²: one function less.
    result[i] = (1.0 - versine * angle2) * X[i] + sine * cross[i] + versine * along * a[i];
  }
}

}  // namespace

double ReprojectionRms(const BalProblem& problem) {
  double sum = 0.0;
  for (const BalObservation& observation : problem.observations) {
    const double* camera = problem.CameraData(observation.camera);
    double P[3];
    Rotate(camera, problem.PointData(observation.point), P);
    // The camera looks along −z: this is the distance in front of it. Zero gives a result that is
    // not finite, which is documented rather than caught.
    const double depth = -(P[2] + camera[5]);
    const double x = (P[0] + camera[3]) / depth, y = (P[1] + camera[4]) / depth;
    const double r2 = x * x + y * y;
    const double scale = camera[6] * (1.0 + camera[7] * r2 + camera[8] * r2 * r2);
    const double error_x = scale * x - observation.x, error_y = scale * y - observation.y;
    sum += error_x * error_x + error_y * error_y;
  }
  return std::sqrt(sum / static_cast<double>(problem.observations.size()));
}

}  // namespace inceres
