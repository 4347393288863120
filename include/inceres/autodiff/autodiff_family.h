#pragma once

#include "inceres/autodiff/differentiate.h"

namespace inceres {

/// Factors given by a functor alone, as a user of Ceres writes them: the Jacobians come by Jets.
/// Needs neither Ceres nor Eigen.
///
///     struct Reprojection {
///       template <typename T>
///       bool operator()(const T* camera, const T* point, T* residuals) const { … }
///       double x, y;  // the measurement
///     };
///     using Reprojections = inceres::AutoDiffFamily<Reprojection, 2, 9, 3>;
///     const auto family = graph.AddFamily(std::make_shared<Reprojections>("reprojection"));
///
/// The functor is the measurement: one per factor, copied. It is called with doubles for the cost
/// and with `inceres::Jet<N>`, N = Σ Ns, for Jacobians, must not throw, and returns false where it
/// cannot be evaluated; functions of Jets (autodiff/jet_math.h) are found as `sqrt(x)`. Jacobians
/// by the values are projected by the variables' manifolds, as AmbientFamily has it, whose
/// obligations and failures are these.
///
/// Cost: one evaluation of the functor with Jets a factor (docs/autodiff.md says what that is);
/// allocates where all parameters as Jets are more than 64 KiB, or kResiduals is kDynamicResiduals.
/// Threads: functors are called concurrently if the solver runs with several; Add and Place are for
/// one writer. Source: Ceres's autodiff_cost_function.h.
///
/// @tparam Functor copyable; see above
/// @tparam kResiduals residuals of a factor, ≥ 1, or kDynamicResiduals
/// @tparam Ns values of each of its variables
template <typename Functor, int kResiduals, int... Ns>
class AutoDiffFamily final
    : public FunctorFamily<AutoDiffFamily<Functor, kResiduals, Ns...>, Functor, kResiduals, Ns...> {
  using Base = FunctorFamily<AutoDiffFamily, Functor, kResiduals, Ns...>;

 public:
  /// (name), (name, tangent_sizes); with kDynamicResiduals (num_residuals, name), (num_residuals,
  /// name, tangent_sizes).
  using Base::Base;

  /// Calls the functor, for AmbientFamily.
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    using Differentiator = internal::Differentiator<Ns...>;
    return jacobians == nullptr
               ? Differentiator::Evaluate(this->at(i), parameters, residuals)
               : Differentiator::template Differentiate<kResiduals>(
                     this->at(i), this->residual_size(), parameters, residuals, jacobians);
  }
};

}  // namespace inceres
