#pragma once

// Cost functors as users of Ceres write them.

#include <cmath>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <ceres/cubic_interpolation.h>
#include <ceres/rotation.h>

#include "inceres/autodiff/jet_eigen.h"

namespace inceres::test {

/// Snavely's camera of nine values, as in Ceres's examples.
struct SnavelyFunctor {
  template <typename T>
  bool operator()(const T* const camera, const T* const point, T* residuals) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    p[0] += camera[3];
    p[1] += camera[4];
    p[2] += camera[5];
    const T xp = -p[0] / p[2];
    const T yp = -p[1] / p[2];
    const T r2 = xp * xp + yp * yp;
    const T distortion = 1.0 + r2 * (camera[7] + camera[8] * r2);
    residuals[0] = camera[6] * distortion * xp - x;
    residuals[1] = camera[6] * distortion * yp - y;
    return true;
  }
  double x = 0.1, y = -0.2;
};

/// Relative pose of translations and quaternions in Eigen's types, as in Ceres's example.
struct RelativePoseFunctor {
  template <typename T>
  bool operator()(const T* const p_a_ptr, const T* const q_a_ptr, const T* const p_b_ptr,
                  const T* const q_b_ptr, T* residuals_ptr) const {
    Eigen::Map<const Eigen::Matrix<T, 3, 1>> p_a(p_a_ptr);
    Eigen::Map<const Eigen::Quaternion<T>> q_a(q_a_ptr);
    Eigen::Map<const Eigen::Matrix<T, 3, 1>> p_b(p_b_ptr);
    Eigen::Map<const Eigen::Quaternion<T>> q_b(q_b_ptr);
    const Eigen::Quaternion<T> q_a_inverse = q_a.conjugate();
    const Eigen::Quaternion<T> q_ab_estimated = q_a_inverse * q_b;
    const Eigen::Matrix<T, 3, 1> p_ab_estimated = q_a_inverse * (p_b - p_a);
    const Eigen::Quaternion<T> delta_q =
        Eigen::Quaterniond(0.9, 0.1, -0.2, 0.3).template cast<T>() * q_ab_estimated.conjugate();
    Eigen::Map<Eigen::Matrix<T, 6, 1>> residuals(residuals_ptr);
    residuals.template block<3, 1>(0, 0) =
        p_ab_estimated - Eigen::Vector3d(0.5, 0.2, -0.1).template cast<T>();
    residuals.template block<3, 1>(3, 0) = T(2.0) * delta_q.vec();
    Eigen::Matrix<double, 6, 6> sqrt_information = Eigen::Matrix<double, 6, 6>::Identity();
    sqrt_information(0, 3) = 0.25;
    sqrt_information(5, 1) = -0.5;
    residuals.applyOnTheLeft(sqrt_information.template cast<T>());
    return true;
  }
};

/// Functions by their full names, Euler angles, a matrix to a quaternion, norms of Eigen.
struct QualifiedFunctor {
  template <typename T>
  bool operator()(const T* const euler, const T* const point, T* residuals) const {
    T R[9];
    ceres::EulerAnglesToRotationMatrix(euler, 3, R);
    T q[4];
    ceres::RotationMatrixToQuaternion(ceres::RowMajorAdapter3x3<const T>(R), q);
    T angle_axis[3];
    ceres::QuaternionToAngleAxis(q, angle_axis);
    T rotated[3];
    ceres::UnitQuaternionRotatePoint(q, point, rotated);
    Eigen::Matrix<T, 3, 1> v(rotated[0], rotated[1], rotated[2]);
    v.normalize();
    residuals[0] = ceres::sqrt(v[0] * v[0] + 2.0) + ceres::pow(v[1] + 3.0, 2) + angle_axis[0];
    residuals[1] = ceres::BesselJ0(v[0]) * ceres::norm(v[1]) + ceres::sin(v[1]) * ceres::exp(v[2]) +
                   ceres::abs(angle_axis[1]);
    residuals[2] = ceres::isfinite(v[2]) ? v.norm() * ceres::hypot(v[0], v[2]) : T(1e6);
    return true;
  }
};

/// A loop over a polynomial whose degree is not known when the program is compiled.
struct PolynomialFunctor {
  template <typename T>
  bool operator()(const T* const coefficients, T* residuals) const {
    for (int r = 0; r < num_points; ++r) {
      T sum(0.0);
      for (int k = 4; k >= 0; --k) {
        sum = sum * (0.1 * r) + coefficients[k];
      }
      residuals[r] = exp(sum) - 1.0;
    }
    return true;
  }
  int num_points = 7;
};

/// Forty values in one block: more than operations are unrolled for.
struct WideFunctor {
  template <typename T>
  bool operator()(const T* const x, const T* const y, T* residuals) const {
    T product(1.0);
    T sum = y[0];
    for (int k = 0; k < 40; ++k) {
      product *= 1.0 + 0.1 * x[k];
      sum += x[k] * x[39 - k] * y[k % 2];
    }
    residuals[0] = product;
    residuals[1] = sum;
    return true;
  }
};

/// Derivatives that are set by hand, as Ceres's own interpolation does.
struct InterpolatingFunctor {
  template <typename T>
  bool operator()(const T* const position, T* residual) const {
    static const double kValues[] = {0, 1, 4, 2, 5, 3, 8, 6, 7, 2, 1, 9, 4, 4, 0, 3,
                                     2, 7, 5, 1, 6, 3, 2, 8, 9, 0, 1, 4, 3, 5, 7, 2};
    const ceres::Grid1D<double, 1> grid(kValues, 0, 32);
    const ceres::CubicInterpolator<ceres::Grid1D<double, 1>> interpolator(grid);
    interpolator.Evaluate(10.0 + position[0] + position[1] * position[1], residual);
    return true;
  }
};

/// Ten parameter blocks.
struct ManyBlocksFunctor {
  template <typename T>
  bool operator()(const T* a, const T* b, const T* c, const T* d, const T* e, const T* f,
                  const T* g, const T* h, const T* i, const T* j, T* residual) const {
    residual[0] = a[0] * b[0] + c[0] * d[0] - e[0] / (2.0 + f[0] * f[0]) + sin(g[0]) * h[0] +
                  i[0] * j[0] * j[1];
    return true;
  }
};

}  // namespace inceres::test
