#pragma once

#include <cstddef>
#include <vector>

#include "inceres/problem/ambient_family.h"
#include "inceres/problem/rotation.h"

/// One direction, as a vehicle and as the camera on it have seen it.
struct Directions {
  double vehicle[3], camera[3];
};

/// residual = R(q) camera − vehicle. The family writes derivatives by the four numbers of q (x, y,
/// z, w), of which the solver makes those in the manifold's tangent space.
class DirectionFamily : public inceres::AmbientFamily<DirectionFamily> {
 public:
  using Measurement = Directions;
  explicit DirectionFamily(int tangent_size) : AmbientFamily(3, {{4, tangent_size}}) {}

  void Add(const Directions& seen) { directions_.push_back(seen); }
  int size() const override { return static_cast<int>(directions_.size()); }
  const char* Name() const override { return "direction"; }

  // R(q) v = v + 2 w (u × v) + 2 u × (u × v) with q = (u, w).
  bool EvaluateOne(int i, const double* const* x, double* residual, double** J) const {
    const Directions& seen = directions_[static_cast<std::size_t>(i)];
    const double *u = x[0], *v = seen.camera, w = x[0][3];
    double u_v[3], u_u_v[3];
    inceres::Cross(u, v, u_v);
    inceres::Cross(u, u_v, u_u_v);
    const double dot = u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
    const double cross[9] = {0, v[2], -v[1], -v[2], 0, v[0], v[1], -v[0], 0};  // ∂(u × v)/∂u
    for (int r = 0; r < 3; ++r) {
      residual[r] = v[r] + 2.0 * (w * u_v[r] + u_u_v[r]) - seen.vehicle[r];
      for (int c = 0; J != nullptr && J[0] != nullptr && c < 3; ++c) {
        const double diagonal = r == c ? dot : 0.0;
        J[0][4 * r + c] = 2.0 * (w * cross[3 * r + c] + diagonal + u[r] * v[c] - 2.0 * v[r] * u[c]);
        J[0][4 * r + 3] = 2.0 * u_v[r];
      }
    }
    return true;
  }

 private:
  std::vector<Directions> directions_;
};
