#pragma once

#include <cmath>
#include <limits>
#include <ostream>

#include "inceres/autodiff/derivatives.h"

namespace inceres::jets {

/// A number and its N derivatives: what a functor is called with in place of a double.
///
///     x = a + Σ_i v_i ε_i,   ε_i ε_j = 0
///
/// Used as ceres::Jet<double, N> is, and without Ceres or Eigen: the four operations between Jets
/// and with doubles, comparisons of the values (numbers first, derivatives ignored), and the
/// functions of autodiff/jet_math.h, found by argument-dependent lookup as `sqrt(x)`. With Eigen,
/// include autodiff/jet_eigen.h. What differs: there are Jets of doubles only; a
/// default-constructed one is as undefined as a double (`T()` is zero); `v` is no Eigen vector, but
/// can be added, multiplied by numbers and indexed.
///
/// Values and derivatives are computed by the formulas that ceres::Jet has, in its order: where the
/// compiler fuses no multiplications and additions the results are the same bits.
///
/// Cost: that of Derivatives. Threads: a value. Source: forward mode, as in Ceres's jet.h.
template <int N>
struct Jet {
  using Scalar = double;  ///< of the value, and of each derivative
  /// Derivatives: Ceres's name.
  static constexpr int DIMENSION = N;  // NOLINT(readability-identifier-naming)

  double a;          ///< the value
  Derivatives<N> v;  ///< its derivatives

  /// Nothing defined: see above.
  Jet() = default;
  /// A constant.
  INCERES_ALWAYS_INLINE explicit Jet(double value) : a(value), v(Derivatives<N>::Zero()) {}
  /// The variable of index i.
  INCERES_ALWAYS_INLINE Jet(double value, int i) : a(value), v(Derivatives<N>::Unit(i)) {}
  /// A value and derivatives.
  INCERES_ALWAYS_INLINE Jet(double value, const Derivatives<N>& derivatives)
      : a(value), v(derivatives) {}
  /// Copies, member by member, as Derivatives has it.
  INCERES_ALWAYS_INLINE Jet(const Jet& other) : a(other.a), v(other.v) {}
  /// Copies.
  INCERES_ALWAYS_INLINE Jet& operator=(const Jet& other) {
    a = other.a;
    v = other.v;
    return *this;
  }

  /// As the operator alone.
  INCERES_ALWAYS_INLINE Jet& operator+=(const Jet& g) { return *this = *this + g; }
  /// As the operator alone.
  INCERES_ALWAYS_INLINE Jet& operator-=(const Jet& g) { return *this = *this - g; }
  /// As the operator alone.
  INCERES_ALWAYS_INLINE Jet& operator*=(const Jet& g) { return *this = *this * g; }
  /// As the operator alone.
  INCERES_ALWAYS_INLINE Jet& operator/=(const Jet& g) { return *this = *this / g; }
  /// As the operator alone.
  INCERES_ALWAYS_INLINE Jet& operator+=(double s) { return *this = *this + s; }
  /// As the operator alone.
  INCERES_ALWAYS_INLINE Jet& operator-=(double s) { return *this = *this - s; }
  /// As the operator alone.
  INCERES_ALWAYS_INLINE Jet& operator*=(double s) { return *this = *this * s; }
  /// As the operator alone.
  INCERES_ALWAYS_INLINE Jet& operator/=(double s) { return *this = *this / s; }

  /// f
  friend INCERES_ALWAYS_INLINE Jet operator+(const Jet& f) { return f; }
  /// −f
  friend INCERES_ALWAYS_INLINE Jet operator-(const Jet& f) { return {-f.a, -f.v}; }
  /// f + g
  friend INCERES_ALWAYS_INLINE Jet operator+(const Jet& f, const Jet& g) {
    return {f.a + g.a, f.v + g.v};
  }
  /// f + s
  friend INCERES_ALWAYS_INLINE Jet operator+(const Jet& f, double s) { return {f.a + s, f.v}; }
  /// s + f
  friend INCERES_ALWAYS_INLINE Jet operator+(double s, const Jet& f) { return {f.a + s, f.v}; }
  /// f − g
  friend INCERES_ALWAYS_INLINE Jet operator-(const Jet& f, const Jet& g) {
    return {f.a - g.a, f.v - g.v};
  }
  /// f − s
  friend INCERES_ALWAYS_INLINE Jet operator-(const Jet& f, double s) { return {f.a - s, f.v}; }
  /// s − f
  friend INCERES_ALWAYS_INLINE Jet operator-(double s, const Jet& f) { return {s - f.a, -f.v}; }
  /// f g
  friend INCERES_ALWAYS_INLINE Jet operator*(const Jet& f, const Jet& g) {
    return {f.a * g.a, f.a * g.v + f.v * g.a};
  }
  /// f s
  friend INCERES_ALWAYS_INLINE Jet operator*(const Jet& f, double s) { return {f.a * s, f.v * s}; }
  /// s f
  friend INCERES_ALWAYS_INLINE Jet operator*(double s, const Jet& f) { return {f.a * s, f.v * s}; }
  /// f / g
  friend INCERES_ALWAYS_INLINE Jet operator/(const Jet& f, const Jet& g) {
    const double g_inverse = 1.0 / g.a;
    const double quotient = f.a * g_inverse;
    return {quotient, (f.v - quotient * g.v) * g_inverse};
  }
  /// f / s
  friend INCERES_ALWAYS_INLINE Jet operator/(const Jet& f, double s) {
    const double s_inverse = 1.0 / s;
    return {f.a * s_inverse, f.v * s_inverse};
  }
  /// s / g
  friend INCERES_ALWAYS_INLINE Jet operator/(double s, const Jet& g) {
    return {s / g.a, g.v * (-s / (g.a * g.a))};
  }

/// A comparison of values, with Jets and with numbers on either side.
#define INCERES_JET_COMPARISON(op)                                            \
  friend INCERES_ALWAYS_INLINE bool operator op(const Jet& f, const Jet& g) { \
    return f.a op g.a;                                                        \
  }                                                                           \
  friend INCERES_ALWAYS_INLINE bool operator op(const Jet& f, double s) {     \
    return f.a op s;                                                          \
  }                                                                           \
  friend INCERES_ALWAYS_INLINE bool operator op(double s, const Jet& f) {     \
    return s op f.a;                                                          \
  }
  INCERES_JET_COMPARISON(<)
  INCERES_JET_COMPARISON(<=)
  INCERES_JET_COMPARISON(>)
  INCERES_JET_COMPARISON(>=)
  INCERES_JET_COMPARISON(==)
  INCERES_JET_COMPARISON(!=)
#undef INCERES_JET_COMPARISON
};

/// "[a ; v_0, v_1, …]"
template <int N>
std::ostream& operator<<(std::ostream& out, const Jet<N>& f) {
  out << "[" << f.a << " ;";
  for (int i = 0; i < N; ++i) {
    out << (i == 0 ? " " : ", ") << f.v[i];
  }
  return out << "]";
}

// What a Jet's value is, as the C library's functions of these names say; derivatives are ignored.
using std::fpclassify, std::isfinite, std::isgreater, std::isgreaterequal, std::isinf, std::isless,
    std::islessequal, std::islessgreater, std::isnan, std::isnormal, std::isunordered, std::signbit;

/// A function of the C library's, of the value.
#define INCERES_JET_CLASSIFICATION(type, name)       \
  template <int N>                                   \
  INCERES_ALWAYS_INLINE type name(const Jet<N>& f) { \
    return std::name(f.a);                           \
  }
INCERES_JET_CLASSIFICATION(bool, isfinite)
INCERES_JET_CLASSIFICATION(bool, isinf)
INCERES_JET_CLASSIFICATION(bool, isnan)
INCERES_JET_CLASSIFICATION(bool, isnormal)
INCERES_JET_CLASSIFICATION(bool, signbit)
INCERES_JET_CLASSIFICATION(int, fpclassify)
#undef INCERES_JET_CLASSIFICATION

/// A comparison of values that raises no floating-point exception.
#define INCERES_JET_QUIET_COMPARISON(name)                            \
  template <int N>                                                    \
  INCERES_ALWAYS_INLINE bool name(const Jet<N>& f, const Jet<N>& g) { \
    return std::name(f.a, g.a);                                       \
  }                                                                   \
  template <int N>                                                    \
  INCERES_ALWAYS_INLINE bool name(const Jet<N>& f, double s) {        \
    return std::name(f.a, s);                                         \
  }                                                                   \
  template <int N>                                                    \
  INCERES_ALWAYS_INLINE bool name(double s, const Jet<N>& f) {        \
    return std::name(s, f.a);                                         \
  }
INCERES_JET_QUIET_COMPARISON(isgreater)
INCERES_JET_QUIET_COMPARISON(isgreaterequal)
INCERES_JET_QUIET_COMPARISON(isless)
INCERES_JET_QUIET_COMPARISON(islessequal)
INCERES_JET_QUIET_COMPARISON(islessgreater)
INCERES_JET_QUIET_COMPARISON(isunordered)
#undef INCERES_JET_QUIET_COMPARISON

}  // namespace inceres::jets

namespace inceres {
/// The Jet of namespace inceres::jets, where its functions are too: `sqrt(Jet)` and the others
/// would hide those of doubles from code in namespace inceres.
template <int N>
using Jet = jets::Jet<N>;
}  // namespace inceres

/// Those of double, as constants.
template <int N>
struct std::numeric_limits<inceres::jets::Jet<N>> : std::numeric_limits<double> {
 private:
  using Value = inceres::jets::Jet<N>;
  using Double = std::numeric_limits<double>;

 public:
  static Value min() noexcept { return Value((Double::min)()); }                    ///< of double
  static Value max() noexcept { return Value((Double::max)()); }                    ///< of double
  static Value lowest() noexcept { return Value(Double::lowest()); }                ///< of double
  static Value epsilon() noexcept { return Value(Double::epsilon()); }              ///< of double
  static Value round_error() noexcept { return Value(Double::round_error()); }      ///< of double
  static Value infinity() noexcept { return Value(Double::infinity()); }            ///< of double
  static Value quiet_NaN() noexcept { return Value(Double::quiet_NaN()); }          ///< of double
  static Value signaling_NaN() noexcept { return Value(Double::signaling_NaN()); }  ///< of double
  static Value denorm_min() noexcept { return Value(Double::denorm_min()); }        ///< of double
};
