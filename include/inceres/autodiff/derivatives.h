#pragma once

#include <utility>

/// Before a function whose calls are to vanish at every level of optimization, -O0 included: what
/// is known of a Jet when the program is compiled is known only where its operations are inlined.
#define INCERES_ALWAYS_INLINE __attribute__((always_inline)) inline

/// Before a function into which all that it calls is to be inlined, a user's functor for one, and
/// whose short loops are to be written out, so that -O2 gives what -O3 gives. GCC does so
/// recursively, but not into a copy that it makes for its own ends (hence noclone); Clang inlines
/// only what is called directly. Defined as nothing before this header is included
/// (-DINCERES_AUTODIFF_FLATTEN=), functors are inlined where the compiler sees fit: less code, and
/// twice the time.
#ifndef INCERES_AUTODIFF_FLATTEN
#if defined(__clang__)
#define INCERES_AUTODIFF_FLATTEN __attribute__((flatten))
#elif __GNUC__ >= 12 && defined(__OPTIMIZE__) && !defined(__OPTIMIZE_SIZE__)
// From GCC 12 on `optimize` adds to the options of the command line, and takes none of them back.
#define INCERES_AUTODIFF_FLATTEN __attribute__((flatten, noclone, optimize("peel-loops")))
#else
#define INCERES_AUTODIFF_FLATTEN __attribute__((flatten, noclone))
#endif
#endif

namespace inceres::jets {

/// Two doubles in a register that every 64-bit processor has: of SSE2 or of NEON. Wider ones cannot
/// be used in a program that is compiled for all processors, and gain little
/// (docs/autodiff.md).
using Pair = double __attribute__((vector_size(16)));

/// The N derivatives of one number: a vector that can be added, and multiplied by numbers.
///
/// Most derivatives in a cost function are zero for as long as only some of the parameters have
/// been met. Which pairs of them may be nonzero is part of the value: where the compiler knows it,
/// which is wherever functions are inlined, it leaves out the operations on the others. What
/// is left out is exactly what adds or multiplies a zero. So the results are the same bits as
/// without, but for the sign of a zero, and for NaNs that come of 0 · ∞.
///
/// A default-constructed one holds nothing defined, as a double does. Cost: N/2 operations on pairs
/// at most; nothing is allocated. Threads: a value. Source: forward mode, dual numbers (Clifford,
/// 1873); Ceres's Jet.
template <int N>
class Derivatives {
 public:
  static_assert(N > 0, "a Jet has at least one derivative");
  static constexpr int kNumPairs = (N + 1) / 2;  ///< the last one may be half empty

  /// Nothing defined: see above.
  Derivatives() = default;
  /// Copies, member by member: a copy of several at once would wait for what has just been written
  /// in parts.
  INCERES_ALWAYS_INLINE Derivatives(const Derivatives& other) { *this = other; }
  /// Copies, onto itself too.
  // NOLINTNEXTLINE(bugprone-unhandled-self-assignment): each member is copied onto itself
  INCERES_ALWAYS_INLINE Derivatives& operator=(const Derivatives& other) {
    nonzero_ = other.nonzero_;
    ForEach([&](int k) __attribute__((always_inline)) { pairs_[k] = other.pairs_[k]; });
    return *this;
  }

  /// All zero.
  static INCERES_ALWAYS_INLINE Derivatives Zero() {
    Derivatives result;
    result.nonzero_ = 0;
    ForEach([&](int k) __attribute__((always_inline)) { result.pairs_[k] = Pair{}; });
    return result;
  }
  /// Zero but for a one at index i: those of the variable i itself.
  static INCERES_ALWAYS_INLINE Derivatives Unit(int i) {
    Derivatives result = Zero();
    result.Set(i, 1.0);
    return result;
  }
  /// All of one value.
  static INCERES_ALWAYS_INLINE Derivatives Constant(double value) {
    Derivatives result;
    result.nonzero_ = kAll;
    ForEach([&](int k) __attribute__((always_inline)) { result.pairs_[k] = Pair{value, value}; });
    return result;
  }

  /// The number of derivatives.
  static constexpr int size() { return N; }
  /// Derivative i. Requires 0 ≤ i < N.
  INCERES_ALWAYS_INLINE double operator[](int i) const { return pairs_[i / 2][i % 2]; }
  /// Sets derivative i. Requires 0 ≤ i < N.
  INCERES_ALWAYS_INLINE void Set(int i, double value) {
    const Pair pair = pairs_[i / 2];
    pairs_[i / 2] = i % 2 == 0 ? Pair{value, pair[1]} : Pair{pair[0], value};
    nonzero_ |= Bit(i / 2);
  }

  /// −f
  friend INCERES_ALWAYS_INLINE Derivatives operator-(const Derivatives& f) {
    Derivatives result;
    result.nonzero_ = f.nonzero_;
    ForEach([&](int k) __attribute__((always_inline)) {
      result.pairs_[k] = f.IsZero(k) ? Pair{} : -f.pairs_[k];
    });
    return result;
  }
  /// f s
  friend INCERES_ALWAYS_INLINE Derivatives operator*(const Derivatives& f, double s) {
    Derivatives result;
    result.nonzero_ = f.nonzero_;
    ForEach([&](int k) __attribute__((always_inline)) {
      result.pairs_[k] = f.IsZero(k) ? Pair{} : f.pairs_[k] * s;
    });
    return result;
  }
  /// s f
  friend INCERES_ALWAYS_INLINE Derivatives operator*(double s, const Derivatives& f) {
    return f * s;
  }
  /// f + g
  friend INCERES_ALWAYS_INLINE Derivatives operator+(const Derivatives& f, const Derivatives& g) {
    Derivatives result;
    result.nonzero_ = f.nonzero_ | g.nonzero_;
    ForEach([&](int k) __attribute__((always_inline)) {
      result.pairs_[k] = f.IsZero(k)   ? g.pairs_[k]
                         : g.IsZero(k) ? f.pairs_[k]
                                       : f.pairs_[k] + g.pairs_[k];
    });
    return result;
  }
  /// f − g
  friend INCERES_ALWAYS_INLINE Derivatives operator-(const Derivatives& f, const Derivatives& g) {
    Derivatives result;
    result.nonzero_ = f.nonzero_ | g.nonzero_;
    ForEach([&](int k) __attribute__((always_inline)) {
      result.pairs_[k] = g.IsZero(k)   ? f.pairs_[k]
                         : f.IsZero(k) ? -g.pairs_[k]
                                       : f.pairs_[k] - g.pairs_[k];
    });
    return result;
  }

 private:
  // Beyond so many pairs operations are loops, and which pairs are zero is not looked at: the code
  // would become long.
  static constexpr bool kUnrolled = kNumPairs <= 16;
  static constexpr unsigned kAll = ~0U;

  static constexpr unsigned Bit(int k) { return kUnrolled ? 1U << k : kAll; }

  // Whether pair k is known to be zero when the program is compiled.
  INCERES_ALWAYS_INLINE bool IsZero(int k) const {
    if constexpr (kUnrolled) {
      return __builtin_constant_p(nonzero_) && (nonzero_ & Bit(k)) == 0;
    } else {
      return false;
    }
  }

  template <typename Function, int... k>
  static INCERES_ALWAYS_INLINE void Unroll(const Function& function,
                                           std::integer_sequence<int, k...>) {
    (function(k), ...);
  }
  template <typename Function>
  static INCERES_ALWAYS_INLINE void ForEach(const Function& function) {
    if constexpr (kUnrolled) {
      Unroll(function, std::make_integer_sequence<int, kNumPairs>());
    } else {
      for (int k = 0; k < kNumPairs; ++k) {
        function(k);
      }
    }
  }

  Pair pairs_[kNumPairs];
  unsigned nonzero_;  // bit k: pair k may be nonzero
};

}  // namespace inceres::jets
