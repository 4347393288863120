#pragma once

#include "solver/strategy.h"

namespace inceres::internal {

/// (H + Λ) δ = −g with Λ_j = clamp(s_j² H_jj) / (radius s_j²): Ceres's damping of the scaled columns, in unscaled variables.
/// Radius rules: Madsen, Nielsen & Tingleff, "Methods for Non-linear Least Squares Problems", 2004, algorithm 3.16.
class LevenbergMarquardt final : public TrustRegionStrategy {
 public:
  LevenbergMarquardt(const SolverOptions& options, const std::vector<double>& scale);

  Status ComputeStep(LinearModel* model, double* step, int* num_solves) override;
  void StepAccepted(double quality) override;
  void StepRejected() override;
  void StepIsInvalid() override { StepRejected(); }
  double Radius() const override { return radius_; }

 private:
  const std::vector<double>& scale_;
  double radius_;
  double max_radius_;
  double min_diagonal_;
  double max_diagonal_;
  double decrease_factor_ = 2.0;
  std::vector<double> damping_;
};

}  // namespace inceres::internal
