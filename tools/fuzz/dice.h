#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

namespace inceres::fuzz {

/// Random choices, the same on every machine: the engine's bits and plain arithmetic only.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : engine_(seed) {}

  /// Uniform in [0, 1).
  double Unit() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  /// Uniform in [low, high).
  double Between(double low, double high) { return low + Unit() * (high - low); }
  /// Uniform in −1 … 1.
  double Signed() { return Between(-1.0, 1.0); }
  /// Of any magnitude between these, both positive.
  double Magnitude(double low, double high) { return low * std::pow(high / low, Unit()); }
  /// Uniform in low … high, both included.
  int Int(int low, int high) {
    return low + static_cast<int>(engine_() % static_cast<std::uint64_t>(high - low + 1));
  }
  template <typename T>
  const T& OneOf(const std::vector<T>& several) {
    return several[static_cast<std::size_t>(Int(0, static_cast<int>(several.size()) - 1))];
  }
  bool Chance(double probability) { return Unit() < probability; }
  std::uint64_t Bits() { return engine_(); }

 private:
  std::mt19937_64 engine_;
};

/// A seed for stream `index` of `seed`: neighbors have nothing in common (the mixing step of
/// SplitMix64).
inline std::uint64_t SeedOf(std::uint64_t seed, std::uint64_t index) {
  std::uint64_t z = seed * 0x9e3779b97f4a7c15u + (index + 1) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

}  // namespace inceres::fuzz
