#include "adapters/ceres/exact/gradient_check.h"

#include <algorithm>
#include <deque>
#include <utility>
#include <vector>

#include <ceres/gradient_checker.h>
#include <ceres/numeric_diff_options.h>

#include "adapters/ceres/read/index.h"
#include "inceres/problem/ambient_family.h"
#include "src/base/formatted.h"

namespace inceres::internal {
namespace {

using Manifolds = std::vector<const UserManifold*>;

// What Ceres's message says of a residual block.
std::string Identify(const ProblemView& view, std::size_t residual) {
  const ResidualBlockView& block = view.residuals[residual];
  std::string text = "Residual block id " + std::to_string(residual) + "; depends on parameters [";
  for (int s = 0; s < block.num_slots; ++s) {
    text += Formatted("%p", static_cast<const void*>(view.block(view.SlotsOf(block)[s]).values));
    text += s + 1 < block.num_slots ? ", " : "]";
  }
  return text;
}

// Cost functions of one shape, each with what checks it.
class CheckedCostFamily final : public AmbientFamily<CheckedCostFamily> {
 public:
  CheckedCostFamily(const FactorShape& shape, double precision, GradientCheck* check)
      : AmbientFamily<CheckedCostFamily>(shape.num_residuals, shape.slots),
        precision_(precision),
        check_(*check) {}

  void Add(const ceres::CostFunction& cost, Manifolds manifolds,
           const ceres::NumericDiffOptions& differences, std::string identity, int residual) {
    const Manifolds& kept = manifolds_.emplace_back(std::move(manifolds));
    costs_.push_back({&cost, std::make_unique<ceres::GradientChecker>(&cost, &kept, differences),
                      std::move(identity), residual});
  }

  int size() const override { return static_cast<int>(costs_.size()); }
  const char* Name() const override { return "ceres::CostFunction"; }
  std::string Describe(int i) const override {
    return DescribeObject("cost function", costs_[At(i)].function);
  }

  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const Cost& cost = costs_[At(i)];
    if (jacobians == nullptr) {
      return cost.function->Evaluate(parameters, residuals, nullptr);
    }
    ceres::GradientChecker::ProbeResults results;
    const bool right = cost.checker->Probe(parameters, precision_, &results);
    if (!results.return_value) {
      return false;  // then there is nothing to be said of gradients
    }
    std::copy_n(results.residuals.data(), residual_size(), residuals);
    for (std::size_t k = 0; k < results.jacobians.size(); ++k) {
      if (jacobians[k] != nullptr) {
        std::copy_n(results.jacobians[k].data(), results.jacobians[k].size(), jacobians[k]);
      }
    }
    if (!right) {
      check_.Note(cost.residual, "Gradient Error detected!\nExtra info for this residual: " +
                                     cost.identity + "\n" + results.error_log);
    }
    return true;
  }

 private:
  struct Cost {
    const ceres::CostFunction* function;
    std::unique_ptr<ceres::GradientChecker> checker;
    std::string identity;
    int residual;
  };
  double precision_;
  GradientCheck& check_;
  std::deque<Manifolds> manifolds_;
  std::vector<Cost> costs_;
};

}  // namespace

std::shared_ptr<const FactorFamily> GradientCheck::FamilyOf(const ProblemView& view,
                                                            const GraphPlan::Family& family) {
  ceres::NumericDiffOptions differences;
  differences.relative_step_size = options_.gradient_check_numeric_derivative_relative_step_size;
  auto checked = std::make_shared<CheckedCostFamily>(
      family.shape, options_.gradient_check_relative_precision, this);
  for (const int r : family.residuals) {
    const ResidualBlockView& block = view.residuals[At(r)];
    Manifolds manifolds;
    for (int s = 0; s < block.num_slots; ++s) {
      manifolds.push_back(view.block(view.SlotsOf(block)[s]).manifold);
    }
    checked->Add(*block.cost, std::move(manifolds), differences, Identify(view, At(r)), r);
  }
  return checked;
}

void GradientCheck::Note(int residual, const std::string& error) {
  const std::lock_guard<std::mutex> lock(mutex_);
  errors_[residual] += "\n" + error;
}

std::string GradientCheck::message() const {
  std::string text;
  for (const auto& error : errors_) {
    text += error.second;
  }
  return text;
}

}  // namespace inceres::internal
