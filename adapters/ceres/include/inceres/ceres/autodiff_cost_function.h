#pragma once

#include <memory>
#include <utility>

#include <ceres/sized_cost_function.h>
#include <ceres/types.h>

#include "inceres/autodiff/differentiate.h"

/// What functors call by the full name: `ceres::sqrt(x)`. Ceres's own rotation functions, and
/// whatever is called without a namespace, find the functions of our Jets by themselves.
namespace ceres {
using inceres::jets::abs;
using inceres::jets::acos;
using inceres::jets::asin;
using inceres::jets::atan;
using inceres::jets::atan2;
using inceres::jets::BesselJ0;
using inceres::jets::BesselJ1;
using inceres::jets::BesselJn;
using inceres::jets::cbrt;
using inceres::jets::ceil;
using inceres::jets::copysign;
using inceres::jets::cos;
using inceres::jets::cosh;
using inceres::jets::erf;
using inceres::jets::erfc;
using inceres::jets::exp;
using inceres::jets::exp2;
using inceres::jets::expm1;
using inceres::jets::fdim;
using inceres::jets::floor;
using inceres::jets::fma;
using inceres::jets::fmax;
using inceres::jets::fmin;
using inceres::jets::fpclassify;
using inceres::jets::hypot;
using inceres::jets::isfinite;
using inceres::jets::isgreater;
using inceres::jets::isgreaterequal;
using inceres::jets::isinf;
using inceres::jets::isless;
using inceres::jets::islessequal;
using inceres::jets::islessgreater;
using inceres::jets::isnan;
using inceres::jets::isnormal;
using inceres::jets::isunordered;
using inceres::jets::log;
using inceres::jets::log10;
using inceres::jets::log1p;
using inceres::jets::log2;
using inceres::jets::norm;
using inceres::jets::pow;
using inceres::jets::signbit;
using inceres::jets::sin;
using inceres::jets::sinh;
using inceres::jets::sqrt;
using inceres::jets::tan;
using inceres::jets::tanh;
}  // namespace ceres

namespace inceres {

/// ceres::AutoDiffCostFunction with the same template and constructor arguments, several times as
/// fast, for functors as they are: a swap of the namespace, before any solver, Ceres's own too.
///
///     using Cost = inceres::AutoDiffCostFunction<SnavelyReprojectionError, 2, 9, 3>;
///     problem.AddResidualBlock(new Cost(new SnavelyReprojectionError(x, y)), nullptr, c, p);
///
/// The functor is called with inceres::Jet<N> (autodiff/jet.h) in place of ceres::Jet<double, N>;
/// include this header before functors that write `ceres::sqrt(x)` in full, and
/// inceres/autodiff/jet_eigen.h for functors with Eigen's types. Residuals and Jacobians are the
/// same bits as Ceres's where the compiler fuses no multiplications and additions
/// (docs/autodiff.md). Obligations and failures are those of ceres::CostFunction: false where the
/// functor returns false; what a functor forgets to write is 1e302.
///
/// Cost: one evaluation of the functor with Jets of Σ Ns derivatives; allocates where all values as
/// Jets are more than 64 KiB, or the number of residuals is not known when the program is
/// compiled. Threads: as the functor. Source: Ceres's autodiff_cost_function.h.
///
/// @tparam Functor `template <typename T> bool operator()(const T*…, T* residuals) const`
/// @tparam kNumResiduals ≥ 1, or ceres::DYNAMIC
/// @tparam Ns values of each parameter block
template <typename Functor, int kNumResiduals, int... Ns>
class AutoDiffCostFunction final : public ceres::SizedCostFunction<kNumResiduals, Ns...> {
 public:
  /// For a number of residuals that the type has.
  explicit AutoDiffCostFunction(Functor* functor,
                                ceres::Ownership ownership = ceres::TAKE_OWNERSHIP)
      : functor_(functor), ownership_(ownership) {
    static_assert(kNumResiduals != ceres::DYNAMIC,
                  "say how many residuals, for the type does not: (functor, num_residuals)");
  }
  /// For ceres::DYNAMIC residuals: so many.
  AutoDiffCostFunction(Functor* functor, int num_residuals,
                       ceres::Ownership ownership = ceres::TAKE_OWNERSHIP)
      : functor_(functor), ownership_(ownership) {
    static_assert(kNumResiduals == ceres::DYNAMIC,
                  "the type has the number of residuals already: (functor)");
    this->set_num_residuals(num_residuals);
  }
  /// Takes the functor over.
  AutoDiffCostFunction(AutoDiffCostFunction&& other) noexcept
      : functor_(std::move(other.functor_)), ownership_(other.ownership_) {
    this->set_num_residuals(other.num_residuals());
  }
  ~AutoDiffCostFunction() override {
    if (ownership_ == ceres::DO_NOT_TAKE_OWNERSHIP) {
      static_cast<void>(functor_.release());  // whose it stays
    }
  }

  /// As ceres::CostFunction has it.
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    using Differentiator = internal::Differentiator<Ns...>;
    if (jacobians == nullptr) {
      return Differentiator::Evaluate(*functor_, parameters, residuals);
    }
    constexpr int kResiduals = kNumResiduals == ceres::DYNAMIC ? 0 : kNumResiduals;
    return Differentiator::template Differentiate<kResiduals>(*functor_, this->num_residuals(),
                                                              parameters, residuals, jacobians);
  }

  /// The functor.
  const Functor& functor() const { return *functor_; }

 private:
  std::unique_ptr<Functor> functor_;
  ceres::Ownership ownership_;
};

}  // namespace inceres
