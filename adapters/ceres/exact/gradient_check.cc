#include "adapters/ceres/exact/gradient_check.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include <ceres/gradient_checker.h>
#include <ceres/numeric_diff_options.h>
#include <glog/logging.h>

namespace inceres::internal {
namespace {

using Manifolds = std::vector<const UserManifold*>;

std::string AddressText(const double* address) {
  char text[32];
  std::snprintf(text, sizeof(text), "%p", static_cast<const void*>(address));
  return text;
}

// What Ceres's message says of a residual block.
std::string Identify(const ProblemView& view, std::size_t residual) {
  const ResidualBlockView& block = view.residuals[residual];
  std::string text = "Residual block id " + std::to_string(residual) + "; depends on parameters [";
  for (int s = 0; s < block.num_slots; ++s) {
    text += AddressText(view.block(view.SlotsOf(block)[s]).values);
    text += s + 1 < block.num_slots ? ", " : "]";
  }
  return text;
}

// The cost function of a residual block, whose Jacobians are compared whenever they are computed.
class CheckedCost final : public ceres::CostFunction {
 public:
  CheckedCost(const ceres::CostFunction& cost, const Manifolds& manifolds,
              const ceres::NumericDiffOptions& differences, double precision, std::string identity,
              std::size_t residual, GradientCheck* check)
      : cost_(cost),
        checker_(&cost, &manifolds, differences),
        precision_(precision),
        identity_(std::move(identity)),
        residual_(residual),
        check_(*check) {
    set_num_residuals(cost.num_residuals());
    *mutable_parameter_block_sizes() = cost.parameter_block_sizes();
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    if (jacobians == nullptr) {
      return cost_.Evaluate(parameters, residuals, nullptr);
    }
    ceres::GradientChecker::ProbeResults results;
    const bool right = checker_.Probe(parameters, precision_, &results);
    if (!results.return_value) {
      return false;  // then there is nothing to be said of gradients
    }
    std::copy_n(results.residuals.data(), num_residuals(), residuals);
    for (std::size_t k = 0; k < parameter_block_sizes().size(); ++k) {
      if (jacobians[k] != nullptr) {
        std::copy_n(results.jacobians[k].data(), results.jacobians[k].size(), jacobians[k]);
      }
    }
    if (!right) {
      check_.Note(residual_, "Gradient Error detected!\nExtra info for this residual: " +
                                 identity_ + "\n" + results.error_log);
    }
    return true;
  }

 private:
  const ceres::CostFunction& cost_;
  ceres::GradientChecker checker_;
  double precision_;
  std::string identity_;
  std::size_t residual_;
  GradientCheck& check_;
};

}  // namespace

GradientCheck::GradientCheck(const ceres::Solver::Options& options, ProblemView* view)
    : view_(*view), checked_(view->residuals.size()) {
  ceres::NumericDiffOptions differences;
  differences.relative_step_size = options.gradient_check_numeric_derivative_relative_step_size;
  for (std::size_t r = 0; r < view_.residuals.size(); ++r) {
    ResidualBlockView& block = view_.residuals[r];
    given_.push_back(block.cost);
    if (block.fixed) {
      continue;
    }
    Manifolds manifolds;
    for (int s = 0; s < block.num_slots; ++s) {
      manifolds.push_back(view_.block(view_.SlotsOf(block)[s]).manifold);
    }
    checked_[r] = std::make_unique<CheckedCost>(*block.cost, manifolds, differences,
                                                options.gradient_check_relative_precision,
                                                Identify(view_, r), r, this);
    block.cost = checked_[r].get();
  }
}

// The view may have been emptied in between.
GradientCheck::~GradientCheck() {
  for (std::size_t r = 0; r < std::min(view_.residuals.size(), given_.size()); ++r) {
    view_.residuals[r].cost = given_[r];
  }
}

void GradientCheck::Note(std::size_t residual, const std::string& error) {
  const std::lock_guard<std::mutex> lock(mutex_);
  errors_[residual] += "\n" + error;
}

ceres::CallbackReturnType GradientCheck::operator()(const ceres::IterationSummary& /*summary*/) {
  LOG_IF(ERROR, failed()) << "Gradient error detected. Terminating solver.";
  return failed() ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
}

std::string GradientCheck::message() const {
  std::string text;
  for (const auto& error : errors_) {
    text += error.second;
  }
  return text;
}

}  // namespace inceres::internal
