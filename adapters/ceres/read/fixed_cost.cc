#include "adapters/ceres/read/fixed_cost.h"

#include <vector>

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>

#include "adapters/ceres/read/index.h"
#include "inceres/problem/ambient_family.h"

namespace inceres::internal {
namespace {

// Where a cost function is told its parameters and writes its residuals.
struct Scratch {
  std::vector<const double*> parameters;
  std::vector<double> residuals;
};

// cost = ½ρ(‖f‖²); false if the residual block cannot be evaluated. As in Ceres the loss's own
// output is not checked.
bool EvaluateCost(const ProblemView& view, const ResidualBlockView& residual, Scratch* scratch,
                  double* cost) {
  const int num_residuals = residual.num_residuals;
  if (scratch->parameters.size() < At(residual.num_slots)) {
    scratch->parameters.resize(At(residual.num_slots));
  }
  if (scratch->residuals.size() < At(num_residuals)) {
    scratch->residuals.resize(At(num_residuals));
  }
  const int* const slots = view.SlotsOf(residual);
  const double** const parameters = scratch->parameters.data();
  for (int s = 0; s < residual.num_slots; ++s) {
    parameters[s] = view.block(slots[s]).values;
  }
  double* const values = scratch->residuals.data();
  MarkUnwritten(values, num_residuals);
  const bool evaluated = residual.cost->Evaluate(parameters, values, nullptr);
  if (!evaluated || !AreWritten(values, num_residuals)) {
    return false;
  }
  double squared_norm = 0.0;
  for (int k = 0; k < num_residuals; ++k) {
    squared_norm += values[k] * values[k];
  }
  double rho[3] = {squared_norm, 1.0, 0.0};
  if (residual.loss != nullptr) {
    residual.loss->Evaluate(squared_norm, rho);
  }
  *cost = 0.5 * rho[0];
  return true;
}

}  // namespace

FixedCost EvaluateFixedCost(const ProblemView& view, ceres::EvaluationCallback* callback) {
  FixedCost result;
  Scratch scratch;
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
    if (!EvaluateCost(view, view.residuals[r], &scratch, &cost)) {
      result.error = "Evaluation of the residual " + std::to_string(r) +
                     " failed during removal of fixed residual blocks.";
      return result;
    }
    result.cost += cost;
  }
  return result;
}

}  // namespace inceres::internal
