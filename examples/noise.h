#pragma once

#include <cstdint>
#include <random>

/// Random numbers for the examples: the same on every machine, as the distributions of the standard
/// library are not.
class Noise {
 public:
  explicit Noise(std::uint32_t seed) : generator_(seed) {}

  /// In [0, 1).
  double Uniform() { return static_cast<double>(generator_()) / 4294967296.0; }

  /// About normal, of mean 0: a sum of twelve uniform numbers has variance 1.
  double Normal(double sigma) {
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) {
      sum += Uniform();
    }
    return sigma * sum;
  }

 private:
  std::mt19937 generator_;
};
