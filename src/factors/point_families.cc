// The families of a landmark in the world seen by a camera on a body: what they measure of h, the
// landmark in the camera times ω.
#include <algorithm>

#include "factors/image_error.h"
#include "factors/point_chain.h"
#include "inceres/factors/equidistant_reprojection.h"
#include "inceres/factors/point_reprojection.h"

// Each family is a sensor: an error e(h, ω) and its derivative A = ∂e/∂(h, ω), three columns for h
// and one for ω at fixed h. point_chain.h does the rest, the same for all: from the landmark to h =
// R_cᵀ (Rᵀ (X − ω p) − ω t_c), back along the chain to pose, camera and landmark, whitening and the
// tests for what is not finite. h is ω times the landmark in the camera, so errors that depend on
// the direction alone do not see ω and points at infinity are points like others. Only a stereo
// camera, which has a length of its own, does. A camera belongs to the family, not to a factor.

namespace inceres {
namespace {

// What is measured has two rows, of whose U three entries are kept.
struct TwoRows {
  static constexpr int kRows = 2;

  template <typename Observation>
  static void SqrtInformation(const Observation& seen, double* U) {
    internal::UnpackUpper(seen.sqrt_information, U);
  }
};

// A pinhole with distortion: the point in the plane z = 1, then the camera's own model.
struct PixelSensor : TwoRows {
  const PinholeCamera& camera;

  // A = J [I | −u] / h_z with u = h_xy / h_z and J of the camera.
  void Error(const PixelObservation& seen, const double h[3], double /*omega*/, double* e,
             double (*A)[4]) const {
    const double u[2] = {h[0] / h[2], h[1] / h[2]};
    double J[4];
    camera.Project(u[0], u[1], e, A == nullptr ? nullptr : J);
    // Depth 0 makes u infinite, which is found in the whitened residual.
    for (int r = 0; r < 2; ++r) {
      e[r] -= seen.pixel[r];
      if (A != nullptr) {
        A[r][0] = J[2 * r] / h[2];
        A[r][1] = J[2 * r + 1] / h[2];
        A[r][2] = -(A[r][0] * u[0] + A[r][1] * u[1]);
        // The fourth column: the direction of h is all that is seen.
        A[r][3] = 0.0;
      }
    }
  }

  static const char* ReasonAt(const double h[3]) { return internal::ImageReason(h); }
};

// A fisheye takes h itself, not h_xy / h_z: it sees beyond 90°, where h_z ≤ 0.
struct EquidistantSensor : TwoRows {
  const EquidistantCamera& camera;

  void Error(const PixelObservation& seen, const double h[3], double /*omega*/, double* e,
             double (*A)[4]) const {
    double J[6];
    camera.Project(h, e, A == nullptr ? nullptr : J);
    for (int r = 0; r < 2; ++r) {
      e[r] -= seen.pixel[r];
      if (A != nullptr) {
        // ∂(u, v)/∂h of the camera, row by row; it does not depend on ω at fixed h.
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

// A rectified pair: the same row v in both images, and u_r is that of a camera moved by the
// baseline. A move by b in meters is a move by ω b for h, which is ω times the point.
struct StereoSensor {
  static constexpr int kRows = 3;
  const StereoCamera& camera;

  // Three rows: all nine entries of U are kept, the lower ones zero.
  static void SqrtInformation(const StereoObservation& seen, double* U) {
    std::copy_n(seen.sqrt_information, 9, U);
  }

  void Error(const StereoObservation& seen, const double h[3], double omega, double* e,
             double (*A)[4]) const {
    const double f[3] = {camera.f_x, camera.f_y, camera.f_x};
    const double c[3] = {camera.c_x, camera.c_y, camera.c_x};
    // Rows u_l, v, u_r.
    const double z[3] = {seen.left[0], seen.left[1], seen.right_u};
    for (int r = 0; r < 3; ++r) {
      const int axis = r == 1 ? 1 : 0;
      const double shift = r == 2 ? camera.baseline : 0.0;
      // u is (h_x − b ω) / h_z for the right image: ω enters with −f b / h_z.
      const double u = (h[axis] - shift * omega) / h[2];
      e[r] = f[r] * u + c[r] - z[r];
      if (A != nullptr) {
        // A row depends on one of h_x and h_y, on h_z, and through the baseline on ω.
        std::fill_n(A[r], 4, 0.0);
        A[r][axis] = f[r] / h[2];
        A[r][2] = -f[r] * u / h[2];
        A[r][3] = -f[r] * shift / h[2];
      }
    }
  }

  static const char* ReasonAt(const double h[3]) { return internal::ImageReason(h); }
};

// Across the ray: e = B (h / ‖h‖ − d) in the plane tangent to the unit sphere at the measured
// direction.
struct BearingSensor : TwoRows {
  static void Error(const BearingObservation& seen, const double h[3], double /*omega*/, double* e,
                    double (*A)[4]) {
    // Measured directions need not be of unit length.
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
  return internal::EvaluatePoints(*this, batch, PixelSensor{{}, camera_});
}

EvaluationFailure EquidistantReprojectionFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluatePoints(*this, batch, EquidistantSensor{{}, camera_});
}

EvaluationFailure StereoReprojectionFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluatePoints(*this, batch, StereoSensor{camera_});
}

EvaluationFailure BearingFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluatePoints(*this, batch, BearingSensor{});
}

}  // namespace inceres
