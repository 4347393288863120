#include "tools/sim/trajectory.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tools/sim/option_range.h"
#include "tools/sim/portable_math.h"

namespace inceres {
namespace internal {
namespace {

using Shape = TrajectoryOptions::Shape;

constexpr double kPi = 3.14159265358979323846;
constexpr double kRamp = 1.0;  // seconds from standing to full speed

constexpr std::pair<const char*, Shape> kShapes[] = {{"circle", Shape::kCircle},
                                                     {"figure_eight", Shape::kFigureEight},
                                                     {"ellipse", Shape::kEllipse}};

// A function of time at a moment: value, first and second derivative.
struct Jet {
  double f, d, dd;
};

Jet operator*(double factor, const Jet& x) {
  return {factor * x.f, factor * x.d, factor * x.dd};
}

Jet Sin(const Jet& x) {
  const double sine = PortableSin(x.f), cosine = PortableCos(x.f);
  return {sine, cosine * x.d, cosine * x.dd - sine * x.d * x.d};
}

Jet Cos(const Jet& x) {
  const double sine = PortableSin(x.f), cosine = PortableCos(x.f);
  return {cosine, -sine * x.d, -sine * x.dd - cosine * x.d * x.d};
}

// A step from 0 to 1 whose first two derivatives vanish at both ends, and its integral from 0.
Jet Step(double tau) {
  const double square = tau * tau, rest = 1.0 - tau;
  return {square * tau * (10.0 + tau * (-15.0 + 6.0 * tau)), 30.0 * square * rest * rest,
          60.0 * tau * rest * (1.0 - 2.0 * tau)};
}

double StepIntegral(double tau) {
  return tau * tau * tau * tau * (2.5 + tau * (-3.0 + tau));
}

// How far it has moved, in seconds of full speed, and how far it has turned on the spot, in rounds.
struct Progress {
  Jet moved, turned;
};

Progress SpeedingUp(double before, double t) {
  const Jet step = Step(t / kRamp);
  return {{before + kRamp * StepIntegral(t / kRamp), step.f, step.d / kRamp}, {}};
}

Progress SlowingDown(double before, double t) {
  const Jet step = Step(t / kRamp);
  return {{before + t - kRamp * StepIntegral(t / kRamp), 1.0 - step.f, -step.d / kRamp}, {}};
}

Progress Turning(double before, double t, double duration) {
  const Jet step = Step(t / duration);
  return {{before, 0.0, 0.0}, {step.f, step.d / duration, step.dd / (duration * duration)}};
}

// Moving, slowing down, turning on the spot, speeding up, again and again; at full speed at t = 0.
Progress ProgressWithStops(const TrajectoryOptions& options, double t) {
  if (options.stop_every == 0.0) {
    return {{t, 1.0, 0.0}, {}};
  }
  const double round = options.stop_every + 2.0 * kRamp + options.stop_duration;
  const double rounds = std::floor(t / round);
  double before = rounds * (options.stop_every + kRamp);
  t = std::max(t - rounds * round, 0.0);
  if (t < options.stop_every) {
    return {{before + t, 1.0, 0.0}, {}};
  }
  before += options.stop_every;
  t -= options.stop_every;
  if (t < kRamp) {
    return SlowingDown(before, t);
  }
  before += 0.5 * kRamp;
  t -= kRamp;
  return t < options.stop_duration ? Turning(before, t, options.stop_duration)
                                   : SpeedingUp(before, std::min(t - options.stop_duration, kRamp));
}

Progress ProgressAt(const TrajectoryOptions& options, double t) {
  if (options.standing_start == 0.0) {
    return ProgressWithStops(options, t);
  }
  t -= options.standing_start;
  if (t < kRamp) {
    return SpeedingUp(0.0, std::max(t, 0.0));
  }
  Progress progress = ProgressWithStops(options, t - kRamp);
  progress.moved.f += 0.5 * kRamp;
  return progress;
}

std::array<Jet, 3> PlaceOf(const TrajectoryOptions& options, const Jet& phase) {
  const double r = options.radius, h = options.height;
  switch (options.shape) {
    case Shape::kFigureEight:
      return {r * Sin(phase), 0.5 * r * Sin(2.0 * phase), h * Sin(3.0 * phase)};
    case Shape::kEllipse:
      return {r * Cos(phase), 4.0 / 3.0 * r * Sin(phase), h * Sin(10.0 * phase)};
    case Shape::kCircle:
      break;
  }
  return {r * Cos(phase), r * Sin(phase), h * Sin(2.0 * phase)};
}

// Direction and its first derivative, all that is needed of it.
Jet YawOf(Shape shape, const Jet& phase) {
  if (shape != Shape::kFigureEight) {
    return {phase.f + 0.5 * kPi, phase.d, phase.dd};
  }
  // Along the tangent (cos φ, cos 2φ), which never vanishes.
  const double x = PortableCos(phase.f), y = PortableCos(2.0 * phase.f);
  const double dx = -PortableSin(phase.f), dy = -2.0 * PortableSin(2.0 * phase.f);
  return {PortableAtan2(y, x), (x * dy - y * dx) / (x * x + y * y) * phase.d, 0.0};
}

void SetPlace(const std::array<Jet, 3>& place, Motion* motion) {
  for (std::size_t k = 0; k < 3; ++k) {
    motion->pose[k] = place[k].f;
    motion->velocity[k] = place[k].d;
    motion->acceleration[k] = place[k].dd;
  }
}

// R = R_z(yaw) R_y(pitch) R_x(roll) and its angular rate in the body's frame.
void SetOrientation(const Jet& yaw, const Jet& pitch, const Jet& roll, Motion* motion) {
  const Rotation R = Rotation::AboutAxis(2, yaw.f) * Rotation::AboutAxis(1, pitch.f) *
                     Rotation::AboutAxis(0, roll.f);
  const double sign = R.w < 0.0 ? -1.0 : 1.0;
  for (std::size_t k = 0; k < 3; ++k) {
    motion->pose[3 + k] = sign * R.v[k];
  }
  motion->pose[6] = sign * R.w;
  const double sr = PortableSin(roll.f), cr = PortableCos(roll.f);
  const double sp = PortableSin(pitch.f), cp = PortableCos(pitch.f);
  motion->angular_rate = {roll.d - yaw.d * sp, pitch.d * cr + yaw.d * sr * cp,
                          -pitch.d * sr + yaw.d * cr * cp};
}

}  // namespace
}  // namespace internal

Status TrajectoryOptions::Validate() const {
  const internal::OptionRange ranges[] = {{"radius", radius, 0.01, 1e5},
                                          {"height", height, 0, 1e5},
                                          {"period", period, 0.1, 1e6},
                                          {"roll", roll, -1, 1},
                                          {"pitch", pitch, -1, 1},
                                          {"standing_start", standing_start, 0, 1e6},
                                          {"stop_every", stop_every, 0, 1e6},
                                          {"stop_duration", stop_duration, 0.1, 1e6}};
  return internal::CheckRanges("TrajectoryOptions", ranges);
}

Status GetTrajectoryShape(const std::string& name, TrajectoryOptions::Shape* shape) {
  std::string known;
  for (const auto& [candidate, value] : internal::kShapes) {
    if (name == candidate) {
      *shape = value;
      return Status::Ok();
    }
    known += std::string(known.empty() ? "" : ", ") + candidate;
  }
  return Status::Error(StatusCode::kInvalidArgument,
                       "no trajectory '" + name + "'; known are " + known);
}

Motion MotionAt(const TrajectoryOptions& options, double time) {
  const internal::Progress progress = internal::ProgressAt(options, time);
  const internal::Jet phase = (2.0 * internal::kPi / options.period) * progress.moved;
  Motion motion;
  internal::SetPlace(internal::PlaceOf(options, phase), &motion);
  internal::Jet yaw = internal::YawOf(options.shape, phase);
  yaw.f += 2.0 * internal::kPi * progress.turned.f;
  yaw.d += 2.0 * internal::kPi * progress.turned.d;
  internal::SetOrientation(yaw, options.pitch * internal::Sin(progress.moved),
                           options.roll * internal::Cos(progress.moved), &motion);
  return motion;
}

}  // namespace inceres
