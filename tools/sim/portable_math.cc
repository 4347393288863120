#include "tools/sim/portable_math.h"

#include <cmath>

namespace inceres::internal {
namespace {

constexpr double kPi = 3.14159265358979323846;
// pi / 2 in two parts: the first has 33 bits, so that its product with a small integer is exact.
constexpr double kHalfPiHigh = 1.57079632673412561417e+00;
constexpr double kHalfPiLow = 6.07710050650619224932e-11;

// sin and cos of |x| <= pi / 4 by their series.
double SinSeries(double x) {
  double sum = 0.0;
  for (int n = 17; n >= 3; n -= 2) {
    sum = (1.0 + sum) * (-x * x / (n * (n - 1)));
  }
  return x * (1.0 + sum);
}

double CosSeries(double x) {
  double sum = 0.0;
  for (int n = 18; n >= 2; n -= 2) {
    sum = (1.0 + sum) * (-x * x / (n * (n - 1)));
  }
  return 1.0 + sum;
}

// sin(x + quarter turns).
double SinOfTurned(double x, int quarters) {
  const double k = std::floor(x / (0.5 * kPi) + 0.5);
  const double r = (x - k * kHalfPiHigh) - k * kHalfPiLow;
  const int quadrant = static_cast<int>((static_cast<std::int64_t>(k) + quarters) & 3);
  const double value = (quadrant & 1) == 0 ? SinSeries(r) : CosSeries(r);
  return quadrant < 2 ? value : -value;
}

// atan of x >= 0: halving the angle twice brings it below 0.2, where the series is short.
double AtanPositive(double x) {
  if (x > 1.0) {
    return 0.5 * kPi - AtanPositive(1.0 / x);
  }
  for (int i = 0; i < 2; ++i) {
    x = x / (1.0 + std::sqrt(1.0 + x * x));
  }
  double sum = 0.0;
  for (int n = 23; n >= 1; n -= 2) {
    sum = 1.0 / n - x * x * sum;
  }
  return 4.0 * x * sum;
}

std::uint64_t Mix(std::uint64_t x) {  // the finalizer of SplitMix64 (Steele, Lea, Flood 2014)
  x += 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return x ^ (x >> 31);
}

}  // namespace

double PortableSin(double x) {
  return SinOfTurned(x, 0);
}

double PortableCos(double x) {
  return SinOfTurned(x, 1);
}

double PortableLog(double x) {
  int exponent = 0;
  double m = std::frexp(x, &exponent);
  if (m < 0.70710678118654752440) {
    m *= 2.0;
    --exponent;
  }
  const double s = (m - 1.0) / (m + 1.0);  // log m = 2 artanh s
  double sum = 0.0;
  for (int n = 23; n >= 1; n -= 2) {
    sum = 1.0 / n + s * s * sum;
  }
  return exponent * 0.69314718055994530942 + 2.0 * s * sum;
}

double PortableExp(double x) {
  const double k = std::floor(x / 0.69314718055994530942 + 0.5);
  // log 2 in two parts: the first has 33 bits, so that its product with k is exact.
  const double r = (x - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10;
  double sum = 1.0;
  for (int n = 18; n >= 1; --n) {
    sum = 1.0 + sum * r / n;
  }
  return std::ldexp(sum, static_cast<int>(k));
}

double PortableAtan2(double y, double x) {
  if (x == 0.0 && y == 0.0) {
    return 0.0;
  }
  const double size_x = x < 0.0 ? -x : x, size_y = y < 0.0 ? -y : y;
  const double first = size_x == 0.0 ? 0.5 * kPi : AtanPositive(size_y / size_x);
  const double upper = x < 0.0 ? kPi - first : first;
  return y < 0.0 ? -upper : upper;
}

Vector3 operator+(const Vector3& a, const Vector3& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}

Vector3 operator-(const Vector3& a, const Vector3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

Vector3 operator*(double factor, const Vector3& a) {
  return {factor * a[0], factor * a[1], factor * a[2]};
}

double Dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static Vector3 Cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

Rotation Rotation::AboutAxis(int axis, double angle) {
  Rotation result;
  result.w = PortableCos(0.5 * angle);
  result.v[static_cast<std::size_t>(axis)] = PortableSin(0.5 * angle);
  return result;
}

Rotation Rotation::FromAngleAxis(const Vector3& a) {
  const double angle = std::sqrt(Dot(a, a));
  if (angle < 1e-8) {  // sin(x / 2) / x = 1 / 2 up to rounding
    return {1.0, 0.5 * a};
  }
  return {PortableCos(0.5 * angle), (PortableSin(0.5 * angle) / angle) * a};
}

Vector3 Rotation::ToAngleAxis() const {
  const double sign = w < 0.0 ? -1.0 : 1.0;  // q and -q are the same rotation
  const double length = std::sqrt(Dot(v, v));
  if (length < 1e-8) {
    return (2.0 * sign) * v;
  }
  return (sign * 2.0 * PortableAtan2(length, sign * w) / length) * v;
}

Vector3 Rotation::operator*(const Vector3& x) const {
  const Vector3 t = 2.0 * Cross(v, x);
  return x + w * t + Cross(v, t);
}

Rotation Rotation::operator*(const Rotation& other) const {
  return {w * other.w - Dot(v, other.v), w * other.v + other.w * v + Cross(v, other.v)};
}

Random::Random(std::uint64_t seed, std::uint64_t stream) : engine_(Mix(Mix(seed) + stream)) {
}

double Random::Uniform() {
  return static_cast<double>(engine_() >> 11) * 0x1p-53;
}

double Random::Uniform(double low, double high) {
  return low + (high - low) * Uniform();
}

// The polar method of Marsaglia; the second number of the pair is not kept, so that a call depends
// on nothing before it.
double Random::Normal() {
  for (;;) {
    const double u = Uniform(-1.0, 1.0), v = Uniform(-1.0, 1.0);
    const double s = u * u + v * v;
    if (s > 0.0 && s < 1.0) {
      return u * std::sqrt(-2.0 * PortableLog(s) / s);
    }
  }
}

int Random::Below(int size) {
  return static_cast<int>(Uniform() * size);
}

Vector3 Random::Normal3(double standard_deviation) {
  const double x = Normal(), y = Normal(),
               z = Normal();  // one after the other: the order of arguments is not specified
  return standard_deviation * Vector3{x, y, z};
}

}  // namespace inceres::internal
