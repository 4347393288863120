#pragma once

#include <array>
#include <string>

#include "inceres/status.h"

namespace inceres {

/// A smooth path through space along which a body moves, in closed form.
///
/// With the phase φ = 2π s / period and s the time it has moved, the place (x, y, z) and the
/// direction it faces are
///
///     kCircle        r cos φ,   r sin φ,       h sin 2φ     along the path
///     kFigureEight   r sin φ,   ½ r sin 2φ,    h sin 3φ     along the path
///     kEllipse       r cos φ,   4/3 r sin φ,   h sin 10φ    φ + 90°
///
/// (kEllipse is the scene of the data generators that the visual-inertial literature uses: an
/// ellipse with half axes of 15 and 20 m, a vertical sine ten times as fast, roll 0.1 cos s, pitch
/// 0.2 sin s.) The body's x axis points forward, y to the left, z up; it rolls by roll · cos s and
/// pitches by pitch · sin s: R = R_z(yaw) R_y(pitch) R_x(roll).
struct TrajectoryOptions {
  enum class Shape : unsigned char { kCircle, kFigureEight, kEllipse };

  Shape shape = Shape::kCircle;
  double radius = 5.0;   ///< r, meters; 0.01 .. 1e5
  double height = 0.5;   ///< h, meters; 0 .. 1e5
  double period = 20.0;  ///< seconds of movement for a round; 0.1 .. 1e6
  double roll = 0.1;     ///< radians; −1 .. 1
  double pitch = 0.2;    ///< radians; −1 .. 1

  /// Seconds at rest before it starts to move. 0: a rolling start, it moves at full speed from the
  /// first moment on.
  double standing_start = 0.0;
  /// Seconds at full speed between stops; 0: it never stops. At a stop it stands and turns once
  /// about the vertical.
  double stop_every = 0.0;
  double stop_duration = 4.0;  ///< seconds at a place; 0.1 .. 1e6; without effect if it never stops

  /// Ok, or kInvalidArgument naming the field, its value and the range.
  Status Validate() const;
};

/// Where a body is and how it moves at a time.
struct Motion {
  std::array<double, 7> pose{};          ///< [p(3), q(x, y, z, w ≥ 0)], world_from_body
  std::array<double, 3> velocity{};      ///< in the world, m/s
  std::array<double, 3> acceleration{};  ///< in the world, m/s²
  std::array<double, 3> angular_rate{};  ///< in the body's frame, rad/s
};

/// The shape named "circle", "figure_eight" or "ellipse". kInvalidArgument listing the known names
/// if there is none of this name (shape unchanged).
Status GetTrajectoryShape(const std::string& name, TrajectoryOptions::Shape* shape);

/// The motion at a time ≥ 0 s, by closed formulas. Between standing and moving lies a second of a
/// smooth change of speed: acceleration and angular rate have a continuous derivative everywhere.
/// Options must be valid. The same bits on every platform with IEEE arithmetic. Cost: some twenty
/// sines.
Motion MotionAt(const TrajectoryOptions& options, double time);

}  // namespace inceres
