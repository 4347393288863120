#pragma once

#include <cmath>

#include "inceres/autodiff/jet.h"

/// What a Jet's value is, as the C library's functions of these names say; derivatives are ignored.
namespace inceres::jets {

using std::fpclassify;
using std::isfinite;
using std::isgreater;
using std::isgreaterequal;
using std::isinf;
using std::isless;
using std::islessequal;
using std::islessgreater;
using std::isnan;
using std::isnormal;
using std::isunordered;
using std::signbit;

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
