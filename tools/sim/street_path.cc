#include "tools/sim/street_path.h"

namespace inceres::internal {
namespace {

constexpr double kTwoPi = 6.28318530717958647692;
// The open street: a sine of 4 m over 80 m turns by 17 degrees to either side.
constexpr double kAmplitude = 4.0;
constexpr double kFrequency = kTwoPi / 80.0;

}  // namespace

StreetPath::StreetPath(double circumference)
    : circumference_(circumference), radius_(circumference / kTwoPi) {
}

Vector3 StreetPath::Position(double s) const {
  if (!closed()) {
    return {kAmplitude * PortableSin(kFrequency * s), 0.0, -s};
  }
  const double heading = s / radius_;
  return {radius_ * (PortableCos(heading) - 1.0), 0.0, -radius_ * PortableSin(heading)};
}

double StreetPath::Heading(double s) const {
  return closed() ? s / radius_
                  : PortableAtan2(-kAmplitude * kFrequency * PortableCos(kFrequency * s), 1.0);
}

Vector3 StreetPath::Place(double s, double left, double height) const {
  const double heading = Heading(s);
  return Position(s) + Vector3{-left * PortableCos(heading), height, left * PortableSin(heading)};
}

double StreetPath::left_room() const {
  return closed() ? 0.6 * radius_ : 1e9;
}

}  // namespace inceres::internal
