#pragma once

#include <cmath>
#include <random>
#include <vector>

namespace inceres {

// The BAL model written down once more, slowly and for any scalar: the tests differentiate it with
// complex steps. Rodrigues' formula R X = X + sinc w × X + cosc w × (w × X).
template <typename T>
void ReferenceResidual(const T* camera, const T* X, double x, double y, T* residual) {
  using std::sin;
  using std::sqrt;
  const T* w = camera;
  const T theta = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
  const bool zero = theta == T(0.0);
  const T half_sine = sin(theta * T(0.5));
  const T sinc = zero ? T(1.0) : sin(theta) / theta;
  const T cosc = zero ? T(0.5) : T(2.0) * (half_sine / theta) * (half_sine / theta);
  const T wX[3] = {w[1] * X[2] - w[2] * X[1], w[2] * X[0] - w[0] * X[2], w[0] * X[1] - w[1] * X[0]};
  const T wwX[3] = {w[1] * wX[2] - w[2] * wX[1], w[2] * wX[0] - w[0] * wX[2],
                    w[0] * wX[1] - w[1] * wX[0]};
  T P[3];
  for (int k = 0; k < 3; ++k) {
    P[k] = X[k] + sinc * wX[k] + cosc * wwX[k] + camera[3 + k];
  }
  const T p[2] = {-P[0] / P[2], -P[1] / P[2]};
  const T r2 = p[0] * p[0] + p[1] * p[1];
  const T distortion = T(1.0) + camera[7] * r2 + camera[8] * r2 * r2;
  residual[0] = camera[6] * distortion * p[0] - T(x);
  residual[1] = camera[6] * distortion * p[1] - T(y);
}

// One camera and one point in front of it.
struct BalState {
  double camera[9];
  double point[3];
  double x;
  double y;
};

// `angle` is the size of the rotation vector; the camera stands back far enough for the point to
// lie in front.
inline BalState RandomBalState(std::mt19937_64& random, double angle) {
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  BalState state;
  double norm = 0.0;
  for (int k = 0; k < 3; ++k) {
    state.camera[k] = uniform(random);
    norm = std::hypot(norm, state.camera[k]);
  }
  for (int k = 0; k < 3; ++k) {
    state.camera[k] *= angle / norm;
    state.point[k] = 4.0 * uniform(random);
    state.camera[3 + k] = uniform(random);
  }
  state.camera[5] = -12.0 + 3.0 * uniform(random);  // ‖X‖ < 7, so the depth is below −1.9
  state.camera[6] = 500.0 + 100.0 * uniform(random);
  state.camera[7] = 0.1 * uniform(random);
  state.camera[8] = 0.02 * uniform(random);
  state.x = 300.0 * uniform(random);
  state.y = 300.0 * uniform(random);
  return state;
}

// A thousand states; angles from exactly 0 over the Taylor branch to π and beyond.
inline std::vector<BalState> ThousandBalStates() {
  const double pi = 3.14159265358979323846;
  const double angles[10] = {0.0, 1e-300, 1e-160, 1e-12, 1e-4, 0.4999, 0.5001, pi - 1e-9, pi, 5.0};
  std::mt19937_64 random(20);
  std::vector<BalState> states;
  for (int k = 0; k < 1000; ++k) {
    const double angle =
        k % 2 == 0 ? angles[(k / 2) % 10] : std::uniform_real_distribution<double>(0.0, pi)(random);
    states.push_back(RandomBalState(random, angle));
  }
  return states;
}

}  // namespace inceres
