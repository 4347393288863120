#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "inceres/autodiff/jet_math.h"
#include "inceres/problem/ambient_family.h"

namespace inceres::internal {

// What is small enough for the stack of a thread, in bytes.
constexpr std::size_t kJetsOnStack = std::size_t{1} << 16;

// An array of Jets: `count` of them, at most kCapacity.
template <typename T, int kCapacity>
class JetsOnStack {
 public:
  INCERES_ALWAYS_INLINE explicit JetsOnStack(int /*count*/) {}
  INCERES_ALWAYS_INLINE T* data() { return values_; }

 private:
  T values_[kCapacity];
};

template <typename T>
class JetsOnHeap {
 public:
  explicit JetsOnHeap(int count) : values_(new T[static_cast<std::size_t>(count)]) {}
  T* data() { return values_.get(); }

 private:
  std::unique_ptr<T[]> values_;  // not make_unique: nothing to set
};

// kCount Jets; 0: as many as the constructor is told.
template <typename T, int kCount>
using Jets = std::conditional_t<kCount != 0 && sizeof(T) * kCount <= kJetsOnStack,
                                JetsOnStack<T, kCount == 0 ? 1 : kCount>, JetsOnHeap<T>>;

// The derivatives of functors with parameter blocks of Ns values, by Jets.
template <int... Ns>
class Differentiator {
 public:
  static_assert(sizeof...(Ns) > 0, "a functor has at least one parameter block");
  static_assert(((Ns > 0) && ...), "a parameter block has at least one value");
  static constexpr int kNumBlocks = static_cast<int>(sizeof...(Ns));
  // Values of all blocks: each is a derivative.
  static constexpr int kNumParameters = (Ns + ...);
  // What the functor is called with.
  using T = Jet<kNumParameters>;

  // By doubles.
  template <typename Functor>
  static INCERES_ALWAYS_INLINE bool Evaluate(const Functor& functor,
                                             const double* const* parameters, double* residuals) {
    return Call(functor, parameters, residuals, Blocks());
  }

  // By Jets: the residuals, kResiduals or, where that is 0, num_residuals, and the Jacobians whose
  // pointers are not null, row-major. What the functor does not write is kUnwritten. False, and
  // nothing written, where it returns false.
  template <int kResiduals, typename Functor>
  INCERES_AUTODIFF_FLATTEN static bool Differentiate(const Functor& functor, int num_residuals,
                                                     const double* const* parameters,
                                                     double* residuals, double** jacobians) {
    Jets<T, kNumParameters> inputs(kNumParameters);
    Jets<T, kResiduals> outputs(num_residuals);
    T* const x = inputs.data();
    T* const y = outputs.data();
    Seed(parameters, x, Blocks());
    Repeat<kResiduals>(
        num_residuals, [y](int r) __attribute__((always_inline)) {
          y[r] = T(kUnwritten, jets::Derivatives<kNumParameters>::Constant(kUnwritten));
        });
    if (!Call(functor, BlocksOf(x, Blocks()).data(), y, Blocks())) {
      return false;
    }
    Repeat<kResiduals>(
        num_residuals,
        [ y, residuals ](int r) __attribute__((always_inline)) { residuals[r] = y[r].a; });
    TakeAll<kResiduals>(num_residuals, y, jacobians, Blocks());
    return true;
  }

 private:
  using Blocks = std::make_integer_sequence<int, kNumBlocks>;
  static constexpr std::array<int, sizeof...(Ns)> kSizes = {Ns...};

  static constexpr int Offset(int block) {
    int offset = 0;
    for (int b = 0; b < block; ++b) {
      offset += kSizes[static_cast<std::size_t>(b)];
    }
    return offset;
  }
  static constexpr int Size(int block) { return kSizes[static_cast<std::size_t>(block)]; }

  template <typename Function, int... k>
  static INCERES_ALWAYS_INLINE void Unroll(const Function& function,
                                           std::integer_sequence<int, k...>) {
    (function(k), ...);
  }
  // function(0) to function(count − 1). Few are written out, so that every index is known when the
  // program is compiled; kCount = 0: `count` is not.
  template <int kCount, typename Function>
  static INCERES_ALWAYS_INLINE void Repeat(int count, const Function& function) {
    if constexpr (kCount > 0 && kCount <= 32) {
      Unroll(function, std::make_integer_sequence<int, kCount>());
    } else {
      for (int k = 0; k < count; ++k) {
        function(k);
      }
    }
  }

  // Not always inlined, as all else is: GCC orders functions without regard to what such ones call,
  // and would flatten before the functor is ready to be inlined, or not at all.
  template <typename Functor, typename Scalar, int... b>
  static bool Call(const Functor& functor, const Scalar* const* blocks, Scalar* residuals,
                   std::integer_sequence<int, b...>) {
    return functor(blocks[b]..., residuals);
  }

  template <int... b>
  static INCERES_ALWAYS_INLINE std::array<const T*, sizeof...(Ns)> BlocksOf(
      const T* x, std::integer_sequence<int, b...>) {
    return {(x + Offset(b))...};
  }

  template <int... b>
  static INCERES_ALWAYS_INLINE void Seed(const double* const* parameters, T* x,
                                         std::integer_sequence<int, b...>) {
    (SeedBlock<Size(b), Offset(b)>(parameters[b], x + Offset(b)), ...);
  }
  template <int kSize, int kOffset>
  static INCERES_ALWAYS_INLINE void SeedBlock(const double* values, T* x) {
    Repeat<kSize>(
        kSize,
        [ values, x ](int i) __attribute__((always_inline)) { x[i] = T(values[i], kOffset + i); });
  }

  template <int kResiduals, int... b>
  static INCERES_ALWAYS_INLINE void TakeAll(int num_residuals, const T* y, double** jacobians,
                                            std::integer_sequence<int, b...>) {
    (Take<kResiduals, Size(b), Offset(b)>(num_residuals, y, jacobians[b]), ...);
  }
  template <int kResiduals, int kSize, int kOffset>
  static INCERES_ALWAYS_INLINE void Take(int num_residuals, const T* y, double* jacobian) {
    if (jacobian == nullptr) {
      return;
    }
    Repeat<kResiduals>(
        num_residuals, [ y, jacobian ](int r) __attribute__((always_inline)) {
          Repeat<kSize>(
              kSize, [ y, jacobian, r ](int i) __attribute__((always_inline)) {
                jacobian[r * kSize + i] = y[r].v[kOffset + i];
              });
        });
  }
};

}  // namespace inceres::internal

namespace inceres {

/// In place of a number of residuals: it is given when the program runs.
constexpr int kDynamicResiduals = 0;

/// Factors that are functors of one type, kept by value, for variables of Ns values each: what
/// AutoDiffFamily and NumericDiffFamily have in common. Derived supplies EvaluateOne, as
/// AmbientFamily has it.
///
/// Threads: functors are called concurrently if the solver runs with several; Add and Place are for
/// one writer.
///
/// @tparam Functor copyable
/// @tparam kResiduals residuals of a factor, ≥ 1, or kDynamicResiduals
/// @tparam Ns values of each of its variables
template <typename Derived, typename Functor, int kResiduals, int... Ns>
class FunctorFamily : public MeasuredFamily<Functor, AmbientFamily<Derived>> {
  using Base = MeasuredFamily<Functor, AmbientFamily<Derived>>;

 public:
  /// One a variable: degrees of freedom.
  using TangentSizes = std::array<int, sizeof...(Ns)>;

  /// What error messages call a factor, and the tangent sizes of its variables, where they have
  /// manifolds.
  explicit FunctorFamily(std::string name = "functor", const TangentSizes& tangent_sizes = {Ns...})
      : Base(kResiduals, Slots(tangent_sizes)), name_(std::move(name)) {
    static_assert(kResiduals > 0, "say how many residuals: (num_residuals, name)");
  }
  /// The same for kDynamicResiduals. Requires num_residuals ≥ 1.
  explicit FunctorFamily(int num_residuals, std::string name = "functor",
                         const TangentSizes& tangent_sizes = {Ns...})
      : Base(num_residuals, Slots(tangent_sizes)), name_(std::move(name)) {
    static_assert(kResiduals == kDynamicResiduals, "the type says how many residuals: (name)");
  }

  /// The functor at an index.
  const Functor& at(int index) const { return this->measurement(index); }

  /// What error messages call a factor.
  const char* Name() const override { return name_.c_str(); }

 private:
  static std::vector<FactorFamily::Slot> Slots(const TangentSizes& tangent_sizes) {
    constexpr TangentSizes kAmbientSizes = {Ns...};
    std::vector<FactorFamily::Slot> slots;
    for (std::size_t s = 0; s < sizeof...(Ns); ++s) {
      slots.push_back({kAmbientSizes[s], tangent_sizes[s]});
    }
    return slots;
  }

  std::string name_;
};

}  // namespace inceres
