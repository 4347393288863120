// The families of a landmark in the world seen by a camera on a body: what they measure of h, the
// landmark in the camera times ω.
#include <algorithm>

#include "factors/image_error.h"
#include "factors/point_chain.h"
#include "inceres/factors/bearing.h"
#include "inceres/factors/equidistant_reprojection.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/stereo_reprojection.h"

namespace inceres {
namespace {

struct PixelSensor {
  static constexpr int kRows = 2;
  const PinholeCamera& camera;

  void SqrtInformation(const PixelObservation& seen, double* U) const {
    internal::UnpackUpper(seen.sqrt_information, U);
  }

  // A = J [I | −u] / h_z with u = h_xy / h_z and J of the camera.
  void Error(const PixelObservation& seen, const double h[3], double /*omega*/, double* e,
             double (*A)[4]) const {
    const double u[2] = {h[0] / h[2], h[1] / h[2]};
    double J[4];
    camera.Project(u[0], u[1], e, A == nullptr ? nullptr : J);
    for (int r = 0; r < 2; ++r) {
      e[r] -= seen.pixel[r];
      if (A != nullptr) {
        A[r][0] = J[2 * r] / h[2];
        A[r][1] = J[2 * r + 1] / h[2];
        A[r][2] = -(A[r][0] * u[0] + A[r][1] * u[1]);
        A[r][3] = 0.0;
      }
    }
  }

  static const char* ReasonAt(const double h[3]) { return internal::ImageReason(h); }
};

struct EquidistantSensor {
  static constexpr int kRows = 2;
  const EquidistantCamera& camera;

  static void SqrtInformation(const PixelObservation& seen, double* U) {
    internal::UnpackUpper(seen.sqrt_information, U);
  }

  void Error(const PixelObservation& seen, const double h[3], double /*omega*/, double* e,
             double (*A)[4]) const {
    double J[6];
    camera.Project(h, e, A == nullptr ? nullptr : J);
    for (int r = 0; r < 2; ++r) {
      e[r] -= seen.pixel[r];
      if (A != nullptr) {
        std::copy_n(J + 3 * r, 3, A[r]);
        A[r][3] = 0.0;
      }
    }
  }

  static const char* ReasonAt(const double h[3]) {
    return h[0] == 0.0 && h[1] == 0.0 && h[2] <= 0.0
               ? "the landmark lies straight behind the camera, or in its center"
               : "a residual is not finite";
  }
};

struct StereoSensor {
  static constexpr int kRows = 3;
  const StereoCamera& camera;

  static void SqrtInformation(const StereoObservation& seen, double* U) {
    std::copy_n(seen.sqrt_information, 9, U);
  }

  void Error(const StereoObservation& seen, const double h[3], double omega, double* e,
             double (*A)[4]) const {
    const double f[3] = {camera.f_x, camera.f_y, camera.f_x};
    const double c[3] = {camera.c_x, camera.c_y, camera.c_x};
    const double z[3] = {seen.left[0], seen.left[1], seen.right_u};
    for (int r = 0; r < 3; ++r) {
      const int axis = r == 1 ? 1 : 0;
      const double shift = r == 2 ? camera.baseline : 0.0;
      const double u = (h[axis] - shift * omega) / h[2];
      e[r] = f[r] * u + c[r] - z[r];
      if (A != nullptr) {
        std::fill_n(A[r], 4, 0.0);
        A[r][axis] = f[r] / h[2];
        A[r][2] = -f[r] * u / h[2];
        A[r][3] = -f[r] * shift / h[2];
      }
    }
  }

  static const char* ReasonAt(const double h[3]) { return internal::ImageReason(h); }
};

struct BearingSensor {
  static constexpr int kRows = 2;

  static void SqrtInformation(const BearingObservation& seen, double* U) {
    internal::UnpackUpper(seen.sqrt_information, U);
  }

  static void Error(const BearingObservation& seen, const double h[3], double /*omega*/, double* e,
                    double (*A)[4]) {
    const double norm = internal::Norm(seen.direction);
    const double d[3] = {seen.direction[0] / norm, seen.direction[1] / norm,
                         seen.direction[2] / norm};
    double B[2][3], by_h[2][3];
    internal::TangentBasis(d, B);
    internal::SphereError(h, d, B, e, A == nullptr ? nullptr : by_h);
    for (int r = 0; r < 2 && A != nullptr; ++r) {
      std::copy_n(by_h[r], 3, A[r]);
      A[r][3] = 0.0;
    }
  }

  static const char* ReasonAt(const double h[3]) {
    return internal::Norm(h) == 0.0 ? "the landmark lies in the center of the camera"
                                    : "a residual is not finite";
  }
};

}  // namespace

EvaluationFailure PointReprojectionFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluatePoints(batch, slot(2).ambient_size, perturbation(), PixelSensor{camera_},
                                  [this](int i) -> const Measurement& { return measurement(i); });
}

EvaluationFailure EquidistantReprojectionFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluatePoints(batch, slot(2).ambient_size, perturbation(),
                                  EquidistantSensor{camera_},
                                  [this](int i) -> const Measurement& { return measurement(i); });
}

EvaluationFailure StereoReprojectionFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluatePoints(batch, slot(2).ambient_size, perturbation(),
                                  StereoSensor{camera_},
                                  [this](int i) -> const Measurement& { return measurement(i); });
}

EvaluationFailure BearingFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluatePoints(batch, slot(2).ambient_size, perturbation(), BearingSensor{},
                                  [this](int i) -> const Measurement& { return measurement(i); });
}

}  // namespace inceres
