#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <utility>

#include "inceres/autodiff/differentiate.h"
#include "inceres/status.h"

namespace inceres {

namespace internal {

// Doubles: up to kInline of them on the stack.
template <int kInline>
class ValueBuffer {
 public:
  explicit ValueBuffer(int count)
      : heap_(count > kInline ? new double[static_cast<std::size_t>(count)] : nullptr) {}
  double* data() { return heap_ != nullptr ? heap_.get() : values_; }

 private:
  double values_[kInline];
  std::unique_ptr<double[]> heap_;
};

}  // namespace internal

/// How NumericDiffFamily forms derivatives.
enum class NumericDiffMethod : unsigned char {
  kForward,  ///< (f(x + h) − f(x)) / h, one evaluation a value: error O(h)
  kCentral,  ///< (f(x + h) − f(x − h)) / 2h, two evaluations a value: error O(h²)
};

/// Options of NumericDiffFamily.
struct NumericDiffOptions {
  /// Which differences.
  NumericDiffMethod method = NumericDiffMethod::kCentral;
  /// In (0, 1): the step is this share of the magnitude of the value, but at least √ε = 1.5e-8.
  double relative_step_size = 1e-6;

  /// What is wrong with these options, the culprit named.
  Status Validate() const {
    if (!(relative_step_size > 0.0 && relative_step_size < 1.0)) {
      return Status::Error(StatusCode::kInvalidArgument,
                           "NumericDiffOptions::relative_step_size is " +
                               std::to_string(relative_step_size) + ": it must be in (0, 1)");
    }
    return Status::Ok();
  }
};

/// Factors given by a functor of doubles alone, which may call what nobody can differentiate: a
/// table, a library, a program. The Jacobians come by differences.
///
///     struct Lookup {
///       bool operator()(const double* position, double* residuals) const { … }
///     };
///     inceres::NumericDiffFamily<Lookup, 1, 3> family("lookup");
///
/// For what can be written as a template AutoDiffFamily is exact, and faster. All else is as there.
/// Values off the manifold of a variable, as a quaternion that is no longer of length one, must be
/// bearable: the steps are taken in the values. A functor that returns false a step away makes the
/// factor fail.
///
/// Cost: Σ Ns evaluations a factor, or twice as many, and one more. Allocates where there are more
/// than 64 values or residuals. Threads: as AutoDiffFamily. Source: Ceres's numeric_diff.h, whose
/// steps these are.
///
/// @tparam Functor `bool operator()(const double*…, double* residuals) const`, copyable
/// @tparam kResiduals residuals of a factor, ≥ 1, or kDynamicResiduals
/// @tparam Ns values of each of its variables
template <typename Functor, int kResiduals, int... Ns>
class NumericDiffFamily final : public FunctorFamily<NumericDiffFamily<Functor, kResiduals, Ns...>,
                                                     Functor, kResiduals, Ns...> {
  using Base = FunctorFamily<NumericDiffFamily, Functor, kResiduals, Ns...>;
  using Differentiator = internal::Differentiator<Ns...>;

 public:
  /// (name), (name, tangent_sizes); with kDynamicResiduals (num_residuals, name), (num_residuals,
  /// name, tangent_sizes).
  using Base::Base;

  /// How derivatives are formed from now on. Options that are wrong change nothing.
  Status SetOptions(const NumericDiffOptions& options) {
    Status status = options.Validate();
    if (status.ok()) {
      options_ = options;
    }
    return status;
  }

  /// Calls the functor, for AmbientFamily.
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    if (!Differentiator::Evaluate(this->at(i), parameters, residuals)) {
      return false;
    }
    return jacobians == nullptr || DifferentiateAll(this->at(i), parameters, residuals, jacobians);
  }

 private:
  static constexpr std::array<int, sizeof...(Ns)> kSizes = {Ns...};
  using Buffer = internal::ValueBuffer<64>;

  bool DifferentiateAll(const Functor& functor, const double* const* parameters,
                        const double* residuals, double** jacobians) const {
    Buffer values(Differentiator::kNumParameters);
    Buffer shifted(this->residual_size());
    Buffer opposite(this->residual_size());
    std::array<const double*, sizeof...(Ns)> blocks;
    double* next = values.data();
    for (std::size_t b = 0; b < sizeof...(Ns); ++b) {
      std::copy_n(parameters[b], kSizes[b], next);
      blocks[b] = next;
      next += kSizes[b];
    }
    double* x = values.data();
    for (std::size_t b = 0; b < sizeof...(Ns); ++b) {
      for (int k = 0; jacobians[b] != nullptr && k < kSizes[b]; ++k) {
        if (!DifferentiateBy(functor, blocks.data(), residuals, x + k, shifted.data(),
                             opposite.data(), jacobians[b] + k, kSizes[b])) {
          return false;
        }
      }
      x += kSizes[b];
    }
    return true;
  }

  // By the value *x, which is one of the blocks': a column of a Jacobian.
  bool DifferentiateBy(const Functor& functor, const double* const* blocks, const double* residuals,
                       double* x, double* shifted, double* opposite, double* column,
                       int row_stride) const {
    const double value = *x;
    const double step = std::max(std::sqrt(std::numeric_limits<double>::epsilon()),
                                 std::fabs(value) * options_.relative_step_size);
    const bool central = options_.method == NumericDiffMethod::kCentral;
    *x = value + step;
    bool evaluated = Evaluate(functor, blocks, shifted);
    if (evaluated && central) {
      *x = value - step;
      evaluated = Evaluate(functor, blocks, opposite);
    }
    *x = value;
    const double scale = central ? 1.0 / step / 2.0 : 1.0 / step;
    const double* from = central ? opposite : residuals;
    for (int r = 0; evaluated && r < this->residual_size(); ++r) {
      column[static_cast<std::ptrdiff_t>(r) * row_stride] = (shifted[r] - from[r]) * scale;
    }
    return evaluated;
  }

  // What the functor forgets to write makes the difference kUnwritten or 0; it is found in the
  // residuals themselves.
  bool Evaluate(const Functor& functor, const double* const* blocks, double* residuals) const {
    MarkUnwritten(residuals, this->residual_size());
    return Differentiator::Evaluate(functor, blocks, residuals);
  }

  NumericDiffOptions options_;
};

}  // namespace inceres
