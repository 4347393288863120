#pragma once

#include <memory>
#include <vector>

#include "inceres/solver/options.h"
#include "solver/linear_model.h"

namespace inceres::internal {

/// Computes steps from a linear model and moves its own damping or radius by how well they did. Exact mode: Ceres 2.1's constants
/// and order of operations, restated without scaling J (ceres_contract.md 4.6 and 4.7).
class TrustRegionStrategy {
 public:
  virtual ~TrustRegionStrategy() = default;

  /// The next step (packed). kSingular: there is none at this damping, an invalid step. *num_solves counts linear solves.
  virtual Status ComputeStep(LinearModel* model, double* step, int* num_solves) = 0;

  virtual void StepAccepted(double quality) = 0;
  virtual void StepRejected() = 0;
  virtual void StepIsInvalid() = 0;
  virtual double Radius() const = 0;
};

/// s_j = 1/(1 + ‖J_j‖) as measured at iteration 0, or all ones.
std::vector<double> JacobiScale(const std::vector<double>& diagonal, bool jacobi_scaling);

/// `scale` outlives the strategy.
std::unique_ptr<TrustRegionStrategy> MakeStrategy(const SolverOptions& options, const std::vector<double>& scale);

/// True if every entry of a step is finite.
bool IsFinite(const std::vector<double>& step);

}  // namespace inceres::internal
