#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "inceres/autodiff/differentiate.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/losses.h"
#include "support/random_values.h"

namespace inceres::test {

/// A smooth nonlinear factor with an analytic Jacobian, any residual size and any slots:
///
///     f_r(x) = c_r + Σ_k (A_rk x_k + B_rk sin(x_k + φ_rk))
///
/// over the ambient entries x_k of all slots in turn. Dominated by A, so a least-squares problem of
/// them has one clear minimum nearby.
class SmoothFamily final : public AmbientFamily<SmoothFamily> {
 public:
  using Measurement = std::vector<double>;  // see MakeMeasurement

  SmoothFamily(int residual_size, std::vector<Slot> slots);

  /// Random A, B and φ of a factor, c zero.
  Measurement MakeMeasurement(Random* random) const;
  void Add(Measurement measurement) { measurements_.push_back(std::move(measurement)); }
  void Place(int index, const Measurement& measurement) {
    PlaceIn(&measurements_, index, measurement);
  }
  const Measurement& measurement(int i) const { return measurements_[static_cast<std::size_t>(i)]; }
  /// Sets c so that f is `residuals` at these parameters.
  void SetResiduals(int i, const double* const* parameters, const double* residuals);

  int size() const override { return static_cast<int>(measurements_.size()); }
  const char* Name() const override { return "smooth test factor"; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const;

 private:
  int num_entries_ = 0;  // of all slots
  std::vector<Measurement> measurements_;
};

/// A family whose factors are all computed by one function, as tests write them down.
class FunctionFamily final : public AmbientFamily<FunctionFamily> {
 public:
  using Measurement = int;  // ignored: the function knows factor i
  using Function = std::function<bool(int i, const double* const* parameters, double* residuals,
                                      double** jacobians)>;

  FunctionFamily(int residual_size, std::vector<Slot> slots, Function function)
      : AmbientFamily(residual_size, std::move(slots)), function_(std::move(function)) {}

  void Add(Measurement) { ++size_; }
  void Place(int index, Measurement) { size_ += index == size_ ? 1 : 0; }
  int size() const override { return size_; }
  const char* Name() const override { return "function"; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    return function_(i, parameters, residuals, jacobians);
  }

 private:
  Function function_;
  int size_ = 0;
};

/// f(x…) or f(i, x…), of factor i whose slots are of size 1; a number is the same everywhere.
template <std::size_t... S, typename F>
double ValueOf(const F& f, int i, const double* const* x, std::index_sequence<S...> /*slots*/) {
  if constexpr (std::is_arithmetic_v<F>) {
    return f;
  } else if constexpr (std::is_invocable_v<const F&, decltype(x[S][0])...>) {
    return f(x[S][0]...);
  } else {
    return f(i, x[S][0]...);
  }
}

/// One residual f of scalars, with its derivative by each of them.
template <typename F, typename... D>
FunctionFamily::Function ScalarFunction(F f, D... derivatives) {
  return [=](int i, const double* const* x, double* residuals, double** jacobians) {
    constexpr auto kSlots = std::index_sequence_for<D...>();
    residuals[0] = ValueOf(f, i, x, kSlots);
    int s = 0;
    const auto write = [&](const auto& derivative) {
      if (jacobians != nullptr && jacobians[s] != nullptr) {
        jacobians[s][0] = ValueOf(derivative, i, x, kSlots);
      }
      ++s;
    };
    (write(derivatives), ...);
    return true;
  };
}

template <typename F, typename... D>
std::shared_ptr<FunctionFamily> ScalarFamily(F f, D... derivatives) {
  return std::make_shared<FunctionFamily>(1, std::vector<FactorFamily::Slot>(sizeof...(D), {1, 1}),
                                          ScalarFunction(f, derivatives...));
}

/// f(x…, residuals) or f(i, x…, residuals), of factor i; true where f says nothing.
template <typename F, typename... P>
bool ResultOf(const F& f, int i, P... pointers) {
  if constexpr (std::is_invocable_v<const F&, int, P...>) {
    return ResultOf([&f, i](P... all) { return f(i, all...); }, i, pointers...);
  } else if constexpr (std::is_void_v<std::invoke_result_t<const F&, P...>>) {
    f(pointers...);
    return true;
  } else {
    return f(pointers...);
  }
}

/// Residuals as a generic lambda writes them, of variables of Ns values: see ResultOf. The
/// Jacobians come by Jets.
template <int kResiduals, int... Ns, typename F>
FunctionFamily::Function ByJets(F f) {
  return [f](int i, const double* const* x, double* residuals, double** jacobians) {
    const auto functor = [&f, i](auto*... pointers) { return ResultOf(f, i, pointers...); };
    using Differentiator = internal::Differentiator<Ns...>;
    return jacobians == nullptr ? Differentiator::Evaluate(functor, x, residuals)
                                : Differentiator::template Differentiate<kResiduals>(
                                      functor, kResiduals, x, residuals, jacobians);
  };
}

template <int kResiduals, int... Ns, typename F>
std::shared_ptr<FunctionFamily> JetFamily(F f) {
  return std::make_shared<FunctionFamily>(kResiduals, std::vector<FactorFamily::Slot>{{Ns, Ns}...},
                                          ByJets<kResiduals, Ns...>(f));
}

/// A loss whose ρ, ρ' and ρ'' one function computes of s.
class FunctionLoss final : public Loss {
 public:
  using Function = std::function<std::array<double, 3>(double s)>;

  explicit FunctionLoss(Function function) : function_(std::move(function)) {}
  void Evaluate(double s, double rho[3]) const override {
    const std::array<double, 3> values = function_(s);
    std::copy(values.begin(), values.end(), rho);
  }

 private:
  Function function_;
};

inline std::shared_ptr<const Loss> LossOf(FunctionLoss::Function function) {
  return std::make_shared<FunctionLoss>(std::move(function));
}

/// Of the derivative that it is told: one that is no weight, say.
inline std::shared_ptr<const Loss> LossOfSlope(double slope) {
  return LossOf([slope](double s) { return std::array{s, slope, 0.0}; });
}

}  // namespace inceres::test
