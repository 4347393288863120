#pragma once

#include <cmath>
#include <random>
#include <vector>

namespace inceres::test {

/// Seeded numbers for tests: the same on every machine, because only the engine's bits and plain
/// arithmetic are used.
class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}

  /// Uniform in [-1, 1).
  double Unit() { return static_cast<double>(engine_() >> 11) * 0x1p-52 - 1.0; }
  /// Uniform in [low, high).
  double Between(double low, double high) { return low + 0.5 * (Unit() + 1.0) * (high - low); }
  /// Uniform in 0 … count − 1.
  int Below(int count) { return static_cast<int>(engine_() % static_cast<unsigned>(count)); }

  /// Of mean 0 and standard deviation 1, by Marsaglia's polar method.
  double Gaussian() {
    double x = 0.0, s = 0.0;
    do {
      const double y = Unit();
      x = Unit();
      s = x * x + y * y;
    } while (s >= 1.0 || s == 0.0);
    return x * std::sqrt(-2.0 * std::log(s) / s);
  }

  std::vector<double> Vector(std::size_t count) {
    std::vector<double> values(count);
    for (double& value : values) {
      value = Unit();
    }
    return values;
  }

 private:
  std::mt19937_64 engine_;
};

}  // namespace inceres::test
