#pragma once

#include <array>
#include <cstdint>
#include <random>

namespace inceres::internal {

// Elementary functions made of IEEE operations (+ - * / sqrt) only, so that a simulated scene has
// the same bits everywhere: those of the C library differ in the last place from platform to
// platform. Accurate to about 1e-15; meant for moderate arguments.
double PortableSin(double x);
double PortableCos(double x);
double PortableLog(double x);  ///< x > 0
double PortableExp(double x);  ///< |x| < 700
double PortableAtan2(double y, double x);

using Vector3 = std::array<double, 3>;

Vector3 operator+(const Vector3& a, const Vector3& b);
Vector3 operator-(const Vector3& a, const Vector3& b);
Vector3 operator*(double factor, const Vector3& a);
double Dot(const Vector3& a, const Vector3& b);

/// Unit quaternion w + (x, y, z), a rotation.
struct Rotation {
  double w = 1.0;
  Vector3 v{};

  static Rotation AboutAxis(int axis, double angle);
  static Rotation FromAngleAxis(const Vector3& a);
  Vector3 ToAngleAxis() const;  ///< of length at most pi
  Rotation Inverse() const { return {w, -1.0 * v}; }
  Vector3 operator*(const Vector3& x) const;
  Rotation operator*(const Rotation& other) const;
};

/// Random numbers with the same bits everywhere: std::mt19937_64 is specified to the bit, the
/// distributions of the standard are not. Different streams of one seed are independent, so that
/// switching one noise off leaves everything else as it was.
class Random {
 public:
  Random(std::uint64_t seed, std::uint64_t stream);
  double Uniform();                         ///< [0, 1)
  double Uniform(double low, double high);  ///< [low, high)
  double Normal();                          ///< mean 0, standard deviation 1
  int Below(int size);                      ///< 0 .. size - 1
  Vector3 Normal3(double standard_deviation);

 private:
  std::mt19937_64 engine_;
};

}  // namespace inceres::internal
