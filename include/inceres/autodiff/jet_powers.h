#pragma once

#include <cmath>
#include <limits>

#include "inceres/autodiff/jet.h"

namespace inceres::internal {

// NaN where an exponent has derivatives and its base is negative: no real power is next to it.
template <int N>
void MarkUndefinedPower(const jets::Derivatives<N>& exponent, jets::Derivatives<N>* power) {
  for (int i = 0; i < N; ++i) {
    if (exponent[i] != 0.0) {
      power->Set(i, std::numeric_limits<double>::quiet_NaN());
    }
  }
}

}  // namespace inceres::internal

/// Powers and Bessel functions of Jets, as Ceres's jet.h has them.
namespace inceres::jets {

using std::pow;

/// The Bessel function of the first kind and order 0: J₀' = −J₁
template <int N>
INCERES_ALWAYS_INLINE Jet<N> BesselJ0(const Jet<N>& f) {
  return {::j0(f.a), -::j1(f.a) * f.v};
}
/// The Bessel function of the first kind and order 1: J₁' = (J₀ − J₂) / 2
template <int N>
INCERES_ALWAYS_INLINE Jet<N> BesselJ1(const Jet<N>& f) {
  return {::j1(f.a), 0.5 * (::j0(f.a) - ::jn(2, f.a)) * f.v};
}
/// The Bessel function of the first kind and order n: Jₙ' = (Jₙ₋₁ − Jₙ₊₁) / 2
template <int N>
INCERES_ALWAYS_INLINE Jet<N> BesselJn(int n, const Jet<N>& f) {
  return {::jn(n, f.a), 0.5 * (::jn(n - 1, f.a) - ::jn(n + 1, f.a)) * f.v};
}

/// f^p
template <int N>
INCERES_ALWAYS_INLINE Jet<N> pow(const Jet<N>& f, double p) {
  return {std::pow(f.a, p), p * std::pow(f.a, p - 1.0) * f.v};
}

/// b^f. Where b = 0 and f > 0 the derivative is 0; where b < 0 and f an integer NaN, if f has any.
template <int N>
inline Jet<N> pow(double b, const Jet<N>& f) {
  if (b == 0.0 && f.a > 0.0) {
    return Jet<N>(0.0);
  }
  Jet<N> result(std::pow(b, f.a));
  if (b < 0.0 && f.a == std::floor(f.a)) {
    internal::MarkUndefinedPower(f.v, &result.v);
  } else {
    result.v = std::log(b) * result.a * f.v;
  }
  return result;
}
/// f^g. Where f = 0 the derivative is 0 if g > 1, that of f if g = 1; where f < 0 and g is an
/// integer, that by f alone, and NaN if g has any.
template <int N>
inline Jet<N> pow(const Jet<N>& f, const Jet<N>& g) {
  if (f.a == 0.0 && g.a >= 1.0) {
    return g.a > 1.0 ? Jet<N>(0.0) : f;
  }
  const double value = std::pow(f.a, g.a);
  const double by_base = g.a * std::pow(f.a, g.a - 1.0);
  if (f.a < 0.0 && g.a == std::floor(g.a)) {
    Jet<N> result(value, by_base * f.v);
    internal::MarkUndefinedPower(g.v, &result.v);
    return result;
  }
  return {value, by_base * f.v + value * std::log(f.a) * g.v};
}

}  // namespace inceres::jets
