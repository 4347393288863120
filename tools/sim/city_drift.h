#pragma once

#include <vector>

#include "inceres/io/bal.h"
#include "tools/sim/city_grid.h"

namespace inceres::internal {

/// Where the places of a city are moved to by the drift of a reconstruction that began at the first
/// crossing.
class CityDrift {
 public:
  /// See CityOptions::drift.
  CityDrift(const CityGrid& grid, double drift, Random* random);

  /// Moves cameras and points.
  void Apply(BalProblem* problem) const;

 private:
  // x ↦ scale · R (x − from) + to.
  struct Similarity {
    double scale = 1.0;
    Rotation R;
    Vector3 from{}, to{};

    Vector3 operator*(const Vector3& x) const { return scale * (R * (x - from)) + to; }
  };

  Similarity Along(const Crossing& from, const Crossing& to, double drift, Random* random) const;
  Vector3 Move(const Vector3& place, Rotation* R) const;

  const CityGrid& grid_;
  std::vector<Similarity> of_crossing_;
};

}  // namespace inceres::internal
