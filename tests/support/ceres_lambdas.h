#pragma once

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

#include <ceres/cost_function.h>
#include <ceres/evaluation_callback.h>
#include <ceres/iteration_callback.h>

/// What Ceres has users derive from, made of lambdas. Knows nothing of inceres.
namespace lambdas {

/// A cost function: the lambda is given what Evaluate is given.
class Cost : public ceres::CostFunction {
 public:
  using Function =
      std::function<bool(double const* const* parameters, double* residuals, double** jacobians)>;
  Cost(int num_residuals, const std::vector<int>& sizes, Function function)
      : function_(std::move(function)) {
    set_num_residuals(num_residuals);
    mutable_parameter_block_sizes()->assign(sizes.begin(), sizes.end());
  }
  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    return function_(parameters, residuals, jacobians);
  }

 private:
  Function function_;
};

/// A cost function whose lambda writes every Jacobian: one that nobody asked for is not read, and
/// each is zero before.
class Formula : public Cost {
 public:
  Formula(int num_residuals, const std::vector<int>& sizes, Function formula)
      : Cost(num_residuals, sizes,
             [=](double const* const* parameters, double* residuals, double** jacobians) {
               std::vector<std::vector<double>> unread;
               std::vector<double*> places;
               for (std::size_t s = 0; s < sizes.size(); ++s) {
                 const std::size_t size = static_cast<std::size_t>(num_residuals * sizes[s]);
                 unread.emplace_back(size);
                 const bool asked = jacobians != nullptr && jacobians[s] != nullptr;
                 places.push_back(asked ? jacobians[s] : unread.back().data());
                 std::fill_n(places.back(), size, 0.0);
               }
               return formula(parameters, residuals, places.data());
             }) {}
};

class Callback : public ceres::IterationCallback {
 public:
  using Function = std::function<ceres::CallbackReturnType(const ceres::IterationSummary&)>;
  explicit Callback(Function function) : function_(std::move(function)) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    return function_(summary);
  }

 private:
  Function function_;
};

class Preparation : public ceres::EvaluationCallback {
 public:
  using Function = std::function<void(bool evaluate_jacobians, bool new_evaluation_point)>;
  explicit Preparation(Function function) : function_(std::move(function)) {}
  void PrepareForEvaluation(bool evaluate_jacobians, bool new_evaluation_point) override {
    function_(evaluate_jacobians, new_evaluation_point);
  }

 private:
  Function function_;
};

}  // namespace lambdas
