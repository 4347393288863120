#include "tools/sim/city_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace inceres::internal {
namespace {

// The next facade line, …, −w/2, w/2, p − w/2, p + w/2, …, that a coordinate comes to: as t > `t`.
double NextLine(double from, double speed, double t, double width, double pitch) {
  if (speed == 0.0) {
    return std::numeric_limits<double>::infinity();
  }
  const double at = from + t * speed;
  const double side = speed > 0.0 ? 1.0 : -1.0;
  double least = std::numeric_limits<double>::infinity();
  const double nearest = std::floor(at / pitch + 0.5);
  for (double k = nearest - 1.0; k <= nearest + 1.0; k += 1.0) {
    for (const double line : {k * pitch - 0.5 * width, k * pitch + 0.5 * width}) {
      if ((line - at) * side > 1e-9 * pitch) {
        least = std::min(least, (line - from) / speed);
      }
    }
  }
  return least;
}

}  // namespace

CityGrid::CityGrid(int num_streets, double street_width, double block_length)
    : num_streets_(num_streets), width_(street_width), pitch_(street_width + block_length) {
}

Vector3 CityGrid::Place(const Crossing& crossing) const {
  return {crossing.column * pitch_, 0.0, -crossing.row * pitch_};
}

bool CityGrid::OnStreet(double coordinate) const {
  const double nearest = std::floor(coordinate / pitch_ + 0.5);
  return nearest >= 0.0 && nearest < num_streets_ &&
         std::abs(coordinate - nearest * pitch_) <= 0.5 * width_;
}

double CityGrid::HitsHouse(const Vector3& origin, const Vector3& direction) const {
  const double last = (num_streets_ - 1) * pitch_ + 0.5 * width_;
  const double x = origin[0], north = -origin[2];
  const double to_x = direction[0], to_north = -direction[2];
  for (double t = 0.0;;) {
    const double next = std::min(NextLine(x, to_x, t, width_, pitch_),
                                 NextLine(north, to_north, t, width_, pitch_));
    const double middle = 0.5 * (t + next);
    const double at_x = x + middle * to_x, at_north = north + middle * to_north;
    const bool inside =
        std::min(at_x, at_north) >= -0.5 * width_ && std::max(at_x, at_north) <= last;
    if (!inside || (!OnStreet(at_x) && !OnStreet(at_north))) {
      return t;
    }
    t = next;
  }
}

void CityGrid::Locate(const Vector3& place, Crossing* first, Crossing* second,
                      double* share) const {
  const double limit = num_streets_ - 1;
  const double column = std::clamp(place[0] / pitch_, 0.0, limit);
  const double row = std::clamp(-place[2] / pitch_, 0.0, limit);
  const double near_column = std::floor(column + 0.5), near_row = std::floor(row + 0.5);
  // The street that is nearer: to the north where the place is nearer to a column.
  const bool along_column = std::abs(column - near_column) <= std::abs(row - near_row);
  const double along = along_column ? row : column;
  const double begin = std::min(std::floor(along), limit - 1.0);
  const double half_width = 0.5 * width_ / pitch_;
  *share = std::clamp((along - begin - half_width) / (1.0 - 2.0 * half_width), 0.0, 1.0);
  const int i = static_cast<int>(begin);
  if (along_column) {
    *first = {static_cast<int>(near_column), i};
    *second = {static_cast<int>(near_column), i + 1};
  } else {
    *first = {i, static_cast<int>(near_row)};
    *second = {i + 1, static_cast<int>(near_row)};
  }
}

}  // namespace inceres::internal
