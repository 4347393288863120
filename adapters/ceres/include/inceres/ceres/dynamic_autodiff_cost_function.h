#pragma once

#include <algorithm>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include <ceres/dynamic_cost_function.h>
#include <ceres/types.h>

#include "inceres/autodiff/jet_math.h"
#include "inceres/ceres/autodiff_cost_function.h"

namespace inceres {

/// ceres::DynamicAutoDiffCostFunction with the same template and constructor arguments: for
/// parameter blocks whose number or sizes are known only when the program runs.
///
///     auto* cost = new inceres::DynamicAutoDiffCostFunction<Spline>(new Spline(samples));
///     cost->AddParameterBlock(4);
///     cost->SetNumResiduals(21);
///
/// The functor is called with inceres::Jet<kStride>, as often as the values of all blocks that are
/// not constant need, and otherwise as in AutoDiffCostFunction. Where the sizes are known when the
/// program is compiled AutoDiffCostFunction takes a fraction of the time.
///
/// Cost: one evaluation of the functor per kStride values, at least one; allocates. Threads: as the
/// functor. Source: Ceres's dynamic_autodiff_cost_function.h.
///
/// @tparam Functor `template <typename T> bool operator()(T const* const* blocks, T* residuals)
/// const`
/// @tparam kStride derivatives a call of the functor, ≥ 1
template <typename Functor, int kStride = 4>
class DynamicAutoDiffCostFunction final : public ceres::DynamicCostFunction {
 public:
  /// AddParameterBlock and SetNumResiduals say the rest.
  explicit DynamicAutoDiffCostFunction(Functor* functor,
                                       ceres::Ownership ownership = ceres::TAKE_OWNERSHIP)
      : functor_(functor), ownership_(ownership) {}
  /// Takes the functor and the sizes over.
  DynamicAutoDiffCostFunction(DynamicAutoDiffCostFunction&& other) noexcept
      : functor_(std::move(other.functor_)), ownership_(other.ownership_) {
    *mutable_parameter_block_sizes() = other.parameter_block_sizes();
    set_num_residuals(other.num_residuals());
  }
  ~DynamicAutoDiffCostFunction() override {
    if (ownership_ == ceres::DO_NOT_TAKE_OWNERSHIP) {
      static_cast<void>(functor_.release());  // whose it stays
    }
  }

  /// As ceres::CostFunction has it.
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    if (jacobians == nullptr) {
      return (*functor_)(parameters, residuals);
    }
    Pass pass(*this, parameters);
    std::size_t first = 0;
    const std::vector<Value> wanted = ValuesOf(jacobians);
    do {  // once where all blocks are constant, for the residuals
      const std::size_t end = std::min(first + kStride, wanted.size());
      if (!pass.Run(*functor_, wanted, first, end, residuals)) {
        return false;
      }
      first = end;
    } while (first < wanted.size());
    return true;
  }

  /// The functor.
  const Functor& functor() const { return *functor_; }

 private:
  using T = Jet<kStride>;

  // One of all values, and where its column of a Jacobian goes.
  struct Value {
    std::size_t index;
    double* column;
    int row_stride;
  };

  // The values that derivatives are wanted by.
  std::vector<Value> ValuesOf(double** jacobians) const {
    std::vector<Value> values;
    std::size_t index = 0;
    for (std::size_t b = 0; b < parameter_block_sizes().size(); ++b) {
      const int size = parameter_block_sizes()[b];
      for (int k = 0; jacobians[b] != nullptr && k < size; ++k) {
        values.push_back({index + static_cast<std::size_t>(k), jacobians[b] + k, size});
      }
      index += static_cast<std::size_t>(size);
    }
    return values;
  }

  // What the functor is called with, again and again.
  struct Pass {
    Pass(const DynamicAutoDiffCostFunction& cost, double const* const* parameters)
        : y(static_cast<std::size_t>(cost.num_residuals())) {
      std::vector<std::size_t> offsets;
      for (std::size_t b = 0; b < cost.parameter_block_sizes().size(); ++b) {
        offsets.push_back(x.size());
        for (int k = 0; k < cost.parameter_block_sizes()[b]; ++k) {
          x.push_back(T(parameters[b][k]));
        }
      }
      for (const std::size_t offset : offsets) {
        blocks.push_back(x.data() + offset);
      }
    }

    // Derivatives by the values [first, end) of those wanted.
    INCERES_AUTODIFF_FLATTEN bool Run(const Functor& functor, const std::vector<Value>& wanted,
                                      std::size_t first, std::size_t end, double* residuals) {
      for (std::size_t k = first; k < end; ++k) {
        x[wanted[k].index] = T(x[wanted[k].index].a, static_cast<int>(k - first));
      }
      for (T& residual : y) {
        residual = T(kUnwritten, jets::Derivatives<kStride>::Constant(kUnwritten));
      }
      if (!functor(static_cast<const T* const*>(blocks.data()), y.data())) {
        return false;
      }
      for (std::size_t r = 0; r < y.size(); ++r) {
        residuals[r] = y[r].a;
        for (std::size_t k = first; k < end; ++k) {
          wanted[k].column[r * static_cast<std::size_t>(wanted[k].row_stride)] =
              y[r].v[static_cast<int>(k - first)];
        }
      }
      for (std::size_t k = first; k < end; ++k) {
        x[wanted[k].index] = T(x[wanted[k].index].a);
      }
      return true;
    }

    std::vector<T> x;
    std::vector<T> y;
    std::vector<const T*> blocks;
  };

  std::unique_ptr<Functor> functor_;
  ceres::Ownership ownership_;
};

}  // namespace inceres
