// Residuals and Jacobians of a few functors by inceres::AutoDiffFamily's derivatives: all their
// bits, in one number, which must not depend on how this is compiled. A program that knows neither
// Ceres nor Eigen; it checks itself against differences first.

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>

#include "inceres/autodiff/differentiate.h"

namespace {

using Camera = inceres::internal::Differentiator<9, 3>;
using Many = inceres::internal::Differentiator<40>;

// A camera that turns by R = I + [a]× + [a]×² / 2, with distortion.
struct CameraFunctor {
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residuals) const {
    using std::isfinite;
    using std::sqrt;
    T w[3], ww[3];
    Cross(camera, point, w);
    Cross(camera, w, ww);
    T p[3];
    for (int k = 0; k < 3; ++k) {
      p[k] = point[k] + w[k] + 0.5 * ww[k] + camera[3 + k];
    }
    const T x = -p[0] / p[2];
    const T y = -p[1] / p[2];
    const T r2 = x * x + y * y;
    const T scale = camera[6] * (1.0 + r2 * (camera[7] + camera[8] * r2));
    residuals[0] = scale * x;
    residuals[1] = camera[7] > 0.1001 ? scale * y : sqrt(1.0 + y * y);
    return isfinite(r2);
  }
  template <typename T>
  static void Cross(const T* a, const T* b, T* c) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
  }
};

struct ManyFunctor {
  template <typename T>
  bool operator()(const T* x, T* residuals) const {
    residuals[0] = T(0.0);
    residuals[1] = T(1.0);
    for (int k = 0; k < 40; ++k) {
      residuals[0] += x[k] * x[39 - k] / (2.0 + x[k] * x[k]);
      residuals[1] *= 1.0 - 0.1 * x[k];
    }
    return true;
  }
};

double Value(int i, int k) {
  return std::fmod(0.37 * (k + 1) * (i + 3) + 0.11, 1.0) - 0.5;
}

void AddBits(const double* values, int count, std::uint64_t* sum) {
  for (int k = 0; k < count; ++k) {
    std::uint64_t bits = 0;
    const double value = values[k] + 0.0;  // a zero has no sign
    std::memcpy(&bits, &value, sizeof bits);
    *sum = (*sum ^ bits) * 0x100000001b3U;
  }
}

// Whether the camera's Jacobian is near differences.
bool IsNearDifferences(const double* camera, const double* point, const double* J_camera) {
  for (int k = 0; k < 9; ++k) {
    double plus[9], minus[9], f_plus[2], f_minus[2];
    std::memcpy(plus, camera, sizeof plus);
    std::memcpy(minus, camera, sizeof minus);
    plus[k] += 1e-6;
    minus[k] -= 1e-6;
    CameraFunctor()(plus, point, f_plus);
    CameraFunctor()(minus, point, f_minus);
    for (int r = 0; r < 2; ++r) {
      const double difference = (f_plus[r] - f_minus[r]) / 2e-6;
      if (!(std::fabs(difference - J_camera[9 * r + k]) < 1e-6 * (1.0 + std::fabs(difference)))) {
        std::printf("residual %d, value %d: %g where differences give %g\n", r, k,
                    J_camera[9 * r + k], difference);
        return false;
      }
    }
  }
  return true;
}

}  // namespace

int main() {
  std::uint64_t sum = 14695981039346656037U;
  for (int i = 0; i < 200; ++i) {
    double camera[9], point[3], many[40];
    for (int k = 0; k < 40; ++k) {
      many[k] = Value(i, k);
    }
    std::memcpy(camera, many, sizeof camera);
    std::memcpy(point, many + 9, sizeof point);
    camera[5] -= 4.0;
    double residuals[2], J_camera[18], J_point[6], J_many[80];
    const double* camera_blocks[] = {camera, point};
    double* camera_jacobians[] = {J_camera, J_point};
    if (!Camera::Differentiate<2>(CameraFunctor(), 2, camera_blocks, residuals, camera_jacobians) ||
        !IsNearDifferences(camera, point, J_camera)) {
      return 1;
    }
    AddBits(residuals, 2, &sum);
    AddBits(J_camera, 18, &sum);
    AddBits(J_point, 6, &sum);
    const double* many_blocks[] = {many};
    double* many_jacobians[] = {J_many};
    if (!Many::Differentiate<2>(ManyFunctor(), 2, many_blocks, residuals, many_jacobians)) {
      return 1;
    }
    AddBits(residuals, 2, &sum);
    AddBits(J_many, 80, &sum);
  }
  std::printf("%016llx\n", static_cast<unsigned long long>(sum));
  return 0;
}
