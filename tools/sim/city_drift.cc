#include "tools/sim/city_drift.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace inceres::internal {
namespace {

// From crossing to crossing, for a drift of 1.
constexpr double kRotation = 0.005;   // radians about each axis
constexpr double kScale = 0.01;       // relative
constexpr double kTranslation = 0.1;  // meters along each axis
constexpr double kLeastScale = 0.5;   // of one street

// Of q0 and q1, which are near to each other, in these shares.
Rotation Blend(const Rotation& a, const Rotation& b, double share) {
  const double sign = a.w * b.w + Dot(a.v, b.v) < 0.0 ? -1.0 : 1.0;
  const double to_b = sign * share, to_a = 1.0 - share;
  Rotation sum{to_a * a.w + to_b * b.w, to_a * a.v + to_b * b.v};
  const double norm = std::sqrt(sum.w * sum.w + Dot(sum.v, sum.v));
  return {sum.w / norm, (1.0 / norm) * sum.v};
}

}  // namespace

// The similarity of a crossing, at `to`, as it follows from that of a neighbor: turned, scaled and
// moved at random in the middle of the street.
CityDrift::Similarity CityDrift::Along(const Crossing& from, const Crossing& to, double drift,
                                       Random* random) const {
  const Similarity& known = of_crossing_[static_cast<std::size_t>(grid_.Index(from))];
  const Vector3 place = grid_.Place(to), middle = 0.5 * (grid_.Place(from) + place);
  Similarity next;
  next.R = known.R * Rotation::FromAngleAxis(random->Normal3(kRotation * drift));
  next.scale = known.scale * std::max(kLeastScale, 1.0 + kScale * drift * random->Normal());
  next.from = place;
  next.to = known * middle + next.scale * (next.R * (place - middle)) +
            random->Normal3(kTranslation * drift);
  return next;
}

// Row by row: a crossing that can be reached from the west and from the south gets the mean.
CityDrift::CityDrift(const CityGrid& grid, double drift, Random* random)
    : grid_(grid), of_crossing_(static_cast<std::size_t>(grid.num_crossings())) {
  for (int row = 0; row < grid.num_streets(); ++row) {
    for (int column = 0; column < grid.num_streets(); ++column) {
      const Crossing at{column, row}, west{column - 1, row}, south{column, row - 1};
      Similarity& D = of_crossing_[static_cast<std::size_t>(grid.Index(at))];
      if (column > 0) {
        D = Along(west, at, drift, random);
      }
      if (row > 0) {
        const Similarity other = Along(south, at, drift, random);
        const double share = column > 0 ? 0.5 : 1.0;
        D.R = Blend(D.R, other.R, share);
        D.scale = (1.0 - share) * D.scale + share * other.scale;
        D.from = other.from;
        D.to = (1.0 - share) * D.to + share * other.to;
      }
    }
  }
}

Vector3 CityDrift::Move(const Vector3& place, Rotation* R) const {
  Crossing first, second;
  double share = 0.0;
  grid_.Locate(place, &first, &second, &share);
  const Similarity& a = of_crossing_[static_cast<std::size_t>(grid_.Index(first))];
  const Similarity& b = of_crossing_[static_cast<std::size_t>(grid_.Index(second))];
  *R = Blend(a.R, b.R, share);
  return (1.0 - share) * (a * place) + share * (b * place);
}

void CityDrift::Apply(BalProblem* problem) const {
  Rotation drifted;
  for (int i = 0; i < problem->num_cameras; ++i) {
    double* camera = problem->CameraData(i);
    const Rotation R = Rotation::FromAngleAxis({camera[0], camera[1], camera[2]});
    const Vector3 center = -1.0 * (R.Inverse() * Vector3{camera[3], camera[4], camera[5]});
    const Vector3 moved = Move(center, &drifted);
    const Rotation turned = R * drifted.Inverse();
    const Vector3 a = turned.ToAngleAxis();
    const Vector3 t = -1.0 * (turned * moved);
    std::copy(a.begin(), a.end(), camera);
    std::copy(t.begin(), t.end(), camera + 3);
  }
  for (int i = 0; i < problem->num_points; ++i) {
    double* X = problem->PointData(i);
    const Vector3 moved = Move({X[0], X[1], X[2]}, &drifted);
    std::copy(moved.begin(), moved.end(), X);
  }
}

}  // namespace inceres::internal
