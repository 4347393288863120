#pragma once

#include <cmath>

namespace inceres::benchmarks {

constexpr int kNumSamples = 53;

/// y = a exp(b t) + c at one t, of (a, b, c) or of the three by themselves.
struct OneSample {
  double t;
  double y;
  template <typename T>
  bool operator()(const T* p, T* residual) const {
    residual[0] = p[0] * exp(p[1] * T(t)) + p[2] - T(y);
    return true;
  }
  template <typename T>
  bool operator()(const T* a, const T* b, const T* c, T* residual) const {
    residual[0] = a[0] * exp(b[0] * T(t)) + c[0] - T(y);
    return true;
  }
};

inline OneSample Sample(int i) {
  const double t = 0.1 * i;
  return {t, 2.0 * std::exp(0.3 * t) + 0.5 + 0.05 * std::sin(17.0 * i)};
}

}  // namespace inceres::benchmarks
