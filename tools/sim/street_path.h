#pragma once

#include "tools/sim/portable_math.h"

namespace inceres::internal {

/// The middle of the street on the ground, and how far along it one is: s in meters. World axes: x
/// to the right of the start, y up, the start looks along -z. Either open and gently winding, or a
/// circle of given circumference driven counterclockwise.
class StreetPath {
 public:
  /// `circumference` 0: open.
  explicit StreetPath(double circumference);

  Vector3 Position(double s) const;
  double Heading(double s) const;  ///< rotation about y that turns -z into the direction of travel
  /// The point `left` meters to the left of the middle and `height` above the ground.
  Vector3 Place(double s, double left, double height) const;

  bool closed() const { return circumference_ > 0.0; }
  double circumference() const { return circumference_; }
  /// How far to the left of the middle things may stand: inside a circle there is no more room than
  /// this.
  double left_room() const;

 private:
  double circumference_;
  double radius_;
};

}  // namespace inceres::internal
