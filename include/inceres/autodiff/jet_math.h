#pragma once

#include <cmath>
#include <limits>

#include "inceres/autodiff/jet.h"
#include "inceres/autodiff/jet_powers.h"

namespace inceres::internal {

struct SineAndCosine {
  double sine;
  double cosine;
};

// Both at once, with the same bits as one after the other. GCC sees by itself that both are wanted.
INCERES_ALWAYS_INLINE SineAndCosine SineAndCosineOf(double a) {
#if defined(__clang__) && defined(__GLIBC__)
  SineAndCosine result;
  ::sincos(a, &result.sine, &result.cosine);
  return result;
#else
  return {std::sin(a), std::cos(a)};
#endif
}

constexpr double kLog2 = 0x1.62e42fefa39efp-1;           // log 2
constexpr double kLog10 = 0x1.26bb1bbb55516p+1;          // log 10
constexpr double kTwoOverSqrtPi = 0x1.20dd750429b6dp+0;  // 2 / √π

}  // namespace inceres::internal

/// The functions of a Jet: f(a + v ε) = f(a) + f'(a) v ε. Values are what the C library computes,
/// to the last bit. The derivative of each is said where it is not the one of the textbook. Names,
/// formulas and special cases are those of Ceres's jet.h, so that functors written for Ceres find
/// here all that they find there.
namespace inceres::jets {

// What a functor may call with doubles and Jets alike.
using std::abs, std::acos, std::asin, std::atan, std::atan2, std::cbrt, std::ceil, std::copysign,
    std::cos, std::cosh, std::erf, std::erfc, std::exp, std::exp2, std::expm1, std::fdim,
    std::floor, std::fma, std::fmax, std::fmin, std::hypot, std::log, std::log10, std::log1p,
    std::log2, std::sin, std::sinh, std::sqrt, std::tan, std::tanh;

/// |f|; at 0 the derivative of the side that the zero's sign is of.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> abs(const Jet<N>& f) {
  return {std::abs(f.a), std::copysign(1.0, f.a) * f.v};
}
/// log f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> log(const Jet<N>& f) {
  return {std::log(f.a), f.v * (1.0 / f.a)};
}
/// log₁₀ f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> log10(const Jet<N>& f) {
  return {std::log10(f.a), f.v * (1.0 / (f.a * internal::kLog10))};
}
/// log₂ f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> log2(const Jet<N>& f) {
  return {std::log2(f.a), f.v * (1.0 / (f.a * internal::kLog2))};
}
/// log(1 + f)
template <int N>
INCERES_ALWAYS_INLINE Jet<N> log1p(const Jet<N>& f) {
  return {std::log1p(f.a), f.v * (1.0 / (1.0 + f.a))};
}
/// exp f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> exp(const Jet<N>& f) {
  const double value = std::exp(f.a);
  return {value, value * f.v};
}
/// 2^f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> exp2(const Jet<N>& f) {
  const double value = std::exp2(f.a);
  return {value, f.v * (value * internal::kLog2)};
}
/// exp f − 1
template <int N>
INCERES_ALWAYS_INLINE Jet<N> expm1(const Jet<N>& f) {
  const double value = std::expm1(f.a);
  return {value, (value + 1.0) * f.v};
}
/// √f: no derivative at 0.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> sqrt(const Jet<N>& f) {
  const double value = std::sqrt(f.a);
  return {value, f.v * (1.0 / (2.0 * value))};
}
/// ∛f: no derivative at 0.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> cbrt(const Jet<N>& f) {
  return {std::cbrt(f.a), f.v * (1.0 / (3.0 * std::cbrt(f.a * f.a)))};
}
/// f²: of a real number what std::norm is.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> norm(const Jet<N>& f) {
  return {f.a * f.a, 2.0 * f.a * f.v};
}
/// sin f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> sin(const Jet<N>& f) {
  const internal::SineAndCosine both = internal::SineAndCosineOf(f.a);
  return {both.sine, both.cosine * f.v};
}
/// cos f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> cos(const Jet<N>& f) {
  const internal::SineAndCosine both = internal::SineAndCosineOf(f.a);
  return {both.cosine, -both.sine * f.v};
}
/// tan f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> tan(const Jet<N>& f) {
  const double value = std::tan(f.a);
  return {value, (1.0 + value * value) * f.v};
}
/// arcsin f: no derivative at ±1.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> asin(const Jet<N>& f) {
  return {std::asin(f.a), (1.0 / std::sqrt(1.0 - f.a * f.a)) * f.v};
}
/// arccos f: no derivative at ±1.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> acos(const Jet<N>& f) {
  return {std::acos(f.a), (-1.0 / std::sqrt(1.0 - f.a * f.a)) * f.v};
}
/// arctan f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> atan(const Jet<N>& f) {
  return {std::atan(f.a), (1.0 / (1.0 + f.a * f.a)) * f.v};
}
/// The angle of the vector (x, y): no derivative at (0, 0).
template <int N>
INCERES_ALWAYS_INLINE Jet<N> atan2(const Jet<N>& y, const Jet<N>& x) {
  const double scale = 1.0 / (x.a * x.a + y.a * y.a);
  return {std::atan2(y.a, x.a), scale * (-y.a * x.v + x.a * y.v)};
}
/// sinh f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> sinh(const Jet<N>& f) {
  return {std::sinh(f.a), std::cosh(f.a) * f.v};
}
/// cosh f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> cosh(const Jet<N>& f) {
  return {std::cosh(f.a), std::sinh(f.a) * f.v};
}
/// tanh f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> tanh(const Jet<N>& f) {
  const double value = std::tanh(f.a);
  return {value, (1.0 - value * value) * f.v};
}
/// The error function.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> erf(const Jet<N>& f) {
  return {std::erf(f.a), f.v * std::exp(-f.a * f.a) * internal::kTwoOverSqrtPi};
}
/// 1 − erf f
template <int N>
INCERES_ALWAYS_INLINE Jet<N> erfc(const Jet<N>& f) {
  return {std::erfc(f.a), -f.v * std::exp(-f.a * f.a) * internal::kTwoOverSqrtPi};
}

/// √(x² + y²): no derivative at 0.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> hypot(const Jet<N>& x, const Jet<N>& y) {
  const double value = std::hypot(x.a, y.a);
  return {value, x.a / value * x.v + y.a / value * y.v};
}
/// √(x² + y² + z²): no derivative at 0.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> hypot(const Jet<N>& x, const Jet<N>& y, const Jet<N>& z) {
  const double value = std::hypot(x.a, y.a, z.a);
  return {value, x.a / value * x.v + y.a / value * y.v + z.a / value * z.v};
}
/// x y + z, the value rounded once.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> fma(const Jet<N>& x, const Jet<N>& y, const Jet<N>& z) {
  return {std::fma(x.a, y.a, z.a), y.a * x.v + x.a * y.v + z.v};
}

/// The largest integer that is not above f: its derivative is 0.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> floor(const Jet<N>& f) {
  return Jet<N>(std::floor(f.a));
}
/// The smallest integer that is not below f: its derivative is 0.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> ceil(const Jet<N>& f) {
  return Jet<N>(std::ceil(f.a));
}
/// f with the sign of g; where g is 0 derivatives are not finite, for the sign jumps.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> copysign(const Jet<N>& f, const Jet<N>& g) {
  const double jump = g.a == 0.0 ? std::numeric_limits<double>::infinity() : 0.0;
  const double sign = std::copysign(1.0, f.a) * std::copysign(1.0, g.a);
  return {std::copysign(f.a, g.a), sign * f.v + std::abs(f.a) * jump * g.v};
}

/// fmax, fmin or fdim of a Jet and a number, which makes a constant of the number.
#define INCERES_JET_BINARY(name)                                 \
  template <int N>                                               \
  INCERES_ALWAYS_INLINE Jet<N> name(const Jet<N>& f, double s) { \
    return name(f, Jet<N>(s));                                   \
  }                                                              \
  template <int N>                                               \
  INCERES_ALWAYS_INLINE Jet<N> name(double s, const Jet<N>& f) { \
    return name(Jet<N>(s), f);                                   \
  }
/// The larger one; a NaN is ignored.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> fmax(const Jet<N>& f, const Jet<N>& g) {
  return std::isnan(g.a) || std::isgreater(f.a, g.a) ? f : g;
}
/// The smaller one; a NaN is ignored.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> fmin(const Jet<N>& f, const Jet<N>& g) {
  return std::isnan(f.a) || std::isless(g.a, f.a) ? g : f;
}
/// f − g where that is positive, else 0; NaN if one is.
template <int N>
INCERES_ALWAYS_INLINE Jet<N> fdim(const Jet<N>& f, const Jet<N>& g) {
  if (std::isunordered(f.a, g.a)) {
    return std::numeric_limits<Jet<N>>::quiet_NaN();
  }
  return std::isgreater(f.a, g.a) ? f - g : Jet<N>(0.0);
}
INCERES_JET_BINARY(fmax)
INCERES_JET_BINARY(fmin)
INCERES_JET_BINARY(fdim)
#undef INCERES_JET_BINARY

}  // namespace inceres::jets
