#pragma once

namespace inceres {

/// A pinhole camera with radial-tangential distortion: z > 0 is in front, x right and y down in the image, pixels from its upper
/// left corner. A point (x, y, z) of the camera's frame is seen at
///
///     (a, b) = (x, y) / z,   r² = a² + b²,   s = 1 + k1 r² + k2 r⁴
///     u = f_x (s a + 2 p1 a b + p2 (r² + 2a²)) + c_x
///     v = f_y (s b + p1 (r² + 2b²) + 2 p2 a b) + c_y
///
/// Source: Brown, "Decentering distortion of lenses", 1966; the order of the coefficients is that of OpenCV.
struct PinholeCamera {
  double f_x = 1.0, f_y = 1.0;  ///< focal lengths, pixels
  double c_x = 0.0, c_y = 0.0;  ///< principal point, pixels
  double k1 = 0.0, k2 = 0.0;    ///< radial distortion
  double p1 = 0.0, p2 = 0.0;    ///< tangential distortion

  /// (u, v) of a point (a, b) of the plane z = 1. If J is not null it becomes ∂(u, v)/∂(a, b), row-major. Pure, no allocation.
  void Project(double a, double b, double pixel[2], double* J = nullptr) const {
    const double r2 = a * a + b * b;
    const double s = 1.0 + r2 * (k1 + r2 * k2);
    pixel[0] = f_x * (s * a + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)) + c_x;
    pixel[1] = f_y * (s * b + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b) + c_y;
    if (J != nullptr) {
      const double t = 2.0 * (k1 + 2.0 * k2 * r2);  // ∂s/∂a = a t, ∂s/∂b = b t
      const double mixed = a * b * t + 2.0 * (p1 * a + p2 * b);
      J[0] = f_x * (s + a * a * t + 2.0 * p1 * b + 6.0 * p2 * a);
      J[1] = f_x * mixed;
      J[2] = f_y * mixed;
      J[3] = f_y * (s + b * b * t + 6.0 * p1 * b + 2.0 * p2 * a);
    }
  }
};

}  // namespace inceres
