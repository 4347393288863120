#pragma once

#include "trust_region/strategy.h"

namespace inceres::internal {

/// (H + Λ) δ = −g with Λ_j = clamp(s_j² H_jj) / (radius s_j²): Ceres's damping of the scaled
/// columns, in unscaled variables. Radius rules: Madsen, Nielsen & Tingleff, "Methods for
/// Non-linear Least Squares Problems", 2004, algorithm 3.16; or, as kMarquardt, those of Marquardt,
/// "An Algorithm for Least-Squares Estimation of Nonlinear Parameters", 1963.
class LevenbergMarquardt final : public TrustRegionStrategy {
 public:
  bool Serves(TrustRegionStrategyKind kind) const override { return IsDamped(kind); }
  void Start(const SolverOptions& options, const std::vector<double>& scale) override;
  Status ComputeStep(LinearModel* model, double* step, int* num_solves) override;
  void StepAccepted(double quality) override;
  void StepRejected() override;
  void StepIsInvalid() override { StepRejected(); }
  double Radius() const override { return radius_; }
  double HeldBack(const LinearModel& model, const std::vector<double>& step) override;
  void GetLastSolve(std::vector<double>* damping,
                    std::vector<double>* /*solution*/) const override {
    *damping = damping_;
  }
  std::vector<double> Save() const override;
  bool Restore(const std::vector<double>& saved) override;
  void Widen(double radius) override;
  void Restart(double radius) override;
  void Hold(const std::vector<char>& held) override { held_ = held; }

 private:
  double DampingAt(double s, double H_jj) const;

  bool tenfold_ = false;  // Marquardt's rule
  const std::vector<double>* scale_ = nullptr;
  double radius_ = 0.0;
  double radius_before_ = 0.0;  // before it was widened, until two steps were taken; 0: it was not
  bool is_new_width_ = false;   // no step was taken since
  double max_radius_ = 0.0;
  double min_diagonal_ = 0.0;
  double max_diagonal_ = 0.0;
  double decrease_factor_ = 2.0;
  double growth_ = 0.0;  // of the radius, by Marquardt's rule
  int num_accepted_in_row_ = 0;
  std::vector<double> damping_;
  std::vector<double> damped_step_;
  std::vector<char> held_;
};

}  // namespace inceres::internal
