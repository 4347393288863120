#include "adapters/ceres/read/fixed_cost.h"

#include <vector>

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

#include "inceres/problem/ambient_family.h"

namespace inceres::internal {
namespace {

// cost = ½ρ(‖f‖²); false if the residual block cannot be evaluated. As in Ceres the loss's own
// output is not checked.
bool EvaluateCost(const ProblemView& view, const ResidualBlockView& residual,
                  std::vector<const double*>* parameters, std::vector<double>* values,
                  double* cost) {
  parameters->clear();
  for (int s = 0; s < residual.num_slots; ++s) {
    parameters->push_back(view.block(view.SlotsOf(residual)[s]).values);
  }
  values->resize(static_cast<std::size_t>(residual.num_residuals));
  MarkUnwritten(values->data(), residual.num_residuals);
  const bool evaluated = residual.cost->Evaluate(parameters->data(), values->data(), nullptr);
  if (!evaluated || !AreWritten(values->data(), residual.num_residuals)) {
    return false;
  }
  double squared_norm = 0.0;
  for (const double value : *values) {
    squared_norm += value * value;
  }
  double rho[3] = {squared_norm, 1.0, 0.0};
  if (residual.loss != nullptr) {
    residual.loss->Evaluate(squared_norm, rho);
  }
  *cost = 0.5 * rho[0];
  return true;
}

}  // namespace

FixedCost EvaluateFixedCost(const ProblemView& view, ceres::EvaluationCallback* callback,
                            const std::function<void(std::size_t, double)>& visit) {
  FixedCost result;
  std::vector<const double*> parameters;
  std::vector<double> values;
  const bool any = view.all.num_residual_blocks > view.reduced.num_residual_blocks;
  for (std::size_t r = 0; any && r < view.residuals.size(); ++r) {
    if (!view.residuals[r].fixed) {
      continue;
    }
    if (callback != nullptr) {
      callback->PrepareForEvaluation(/*evaluate_jacobians=*/false, /*new_evaluation_point=*/true);
      callback = nullptr;
    }
    double cost = 0.0;
    if (!EvaluateCost(view, view.residuals[r], &parameters, &values, &cost)) {
      result.error = "Evaluation of the residual " + std::to_string(r) +
                     " failed during removal of fixed residual blocks.";
      return result;
    }
    result.cost += cost;
    if (visit) {
      visit(r, cost);
    }
  }
  return result;
}

}  // namespace inceres::internal
