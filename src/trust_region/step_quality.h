#pragma once

namespace inceres::internal {

/// Ratio of actual to predicted decrease, against the last cost or, for non-monotone steps, against
/// a reference cost from further back. Source: Conn, Gould & Toint, "Trust-Region Methods",
/// algorithm 10.1.2, as in Ceres 2.1 (docs/ceres_contract.md, "Step quality and non-monotonic
/// steps"). A window of 0 is the monotone rule.
class StepQuality {
 public:
  StepQuality(double initial_cost, int max_consecutive_nonmonotonic_steps);

  double Evaluate(double cost, double model_decrease) const;
  void StepAccepted(double cost, double model_decrease);

 private:
  int window_;
  int num_nonmonotonic_steps_ = 0;
  double minimum_cost_;
  double current_cost_;
  double reference_cost_;
  double candidate_cost_;
  double decrease_since_reference_ = 0.0;  // accumulated model decrease
  double decrease_since_candidate_ = 0.0;
};

}  // namespace inceres::internal
