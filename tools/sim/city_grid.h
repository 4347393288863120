#pragma once

#include <array>

#include "tools/sim/portable_math.h"

namespace inceres::internal {

/// A crossing of a street to the north, x = column · pitch, with one to the east, z = −row · pitch.
struct Crossing {
  int column = 0, row = 0;
};

/// num_streets streets each way, with square blocks of houses, of any height, between them and
/// around them. World axes: x to the east, y up, −z to the north; the ground is y = 0.
class CityGrid {
 public:
  CityGrid(int num_streets, double street_width, double block_length);

  int num_streets() const { return num_streets_; }
  int num_crossings() const { return num_streets_ * num_streets_; }
  double street_width() const { return width_; }
  double pitch() const { return pitch_; }  ///< from crossing to crossing

  int Index(const Crossing& c) const { return c.row * num_streets_ + c.column; }
  Vector3 Place(const Crossing& crossing) const;
  bool Contains(const Crossing& c) const {
    return c.column >= 0 && c.row >= 0 && c.column < num_streets_ && c.row < num_streets_;
  }

  /// The first t > 0 at which origin + t · direction meets a house; the origin is on a street. The
  /// direction must not be vertical.
  double HitsHouse(const Vector3& origin, const Vector3& direction) const;

  /// Where a place is on the streets: crossings `first` and `second`, neighbors or the same, and
  /// how far from the one to the other, 0 .. 1; on a crossing it is 0 or 1.
  void Locate(const Vector3& place, Crossing* first, Crossing* second, double* share) const;

 private:
  bool OnStreet(double coordinate) const;

  int num_streets_;
  double width_;
  double pitch_;
};

}  // namespace inceres::internal
