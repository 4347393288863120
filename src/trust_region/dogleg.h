#pragma once

#include <cmath>
#include <optional>
#include <vector>

#include "trust_region/dogleg_subspace.h"
#include "trust_region/strategy.h"

namespace inceres::internal {

/// Where the dog-leg path from the Cauchy point a, inside the sphere ‖p‖ = r, to the Gauss–Newton
/// point b leaves it: the β of p = a + β (b − a). What it takes are r², ‖a‖², aᵀ(b − a) and ‖b −
/// a‖², in whichever metric.
///
/// β is the positive root of ‖b − a‖² β² + 2 aᵀ(b − a) β − (r² − ‖a‖²) = 0, in the one of its two
/// forms in which nothing cancels. Source: Nocedal & Wright, "Numerical Optimization", 2006,
/// section 4.1; Ceres 2.1's DoglegStrategy.
inline double DoglegShare(double squared_radius, double squared_a, double a_dot_difference,
                          double squared_difference) {
  const double to_go = squared_radius - squared_a;
  const double root = std::sqrt(a_dot_difference * a_dot_difference + squared_difference * to_go);
  return a_dot_difference <= 0.0 ? (root - a_dot_difference) / squared_difference
                                 : to_go / (root + a_dot_difference);
}

/// Powell's Dog-Leg in the metric D = clamp(s² diag H)^½ of the scaled columns. With w = D/s
/// everything is said in unscaled variables: g̃ = g/w, Cauchy step −α g̃ with α = ‖g̃‖²/‖J g̃/w‖²,
/// Gauss–Newton step w δ_gn, result δ = p/w. A Gauss–Newton step that leaves the trust region is
/// replaced by the traditional path's point on the sphere, or by the best one of the plane
/// (DoglegSubspace).
///
/// The Gauss–Newton step is regularized by μ w² on the diagonal, μ starting at 1e-8 and rising when
/// the system cannot be factored. Source: Nocedal & Wright, section 4.1; constants of Ceres 2.1's
/// DoglegStrategy.
class Dogleg final : public TrustRegionStrategy {
 public:
  bool Serves(TrustRegionStrategyKind kind) const override { return !IsDamped(kind); }
  void Start(const SolverOptions& options, const std::vector<double>& scale) override;
  Status ComputeStep(LinearModel* model, double* step, int* num_solves) override;
  void StepAccepted(double quality) override;
  void StepRejected() override;
  void StepIsInvalid() override;
  double Radius() const override { return radius_; }
  double HeldBack(const LinearModel& model, const std::vector<double>& step) override;
  std::vector<double> Save() const override { return {radius_, mu_}; }
  bool Restore(const std::vector<double>& saved) override;
  void GetLastSolve(std::vector<double>* damping, std::vector<double>* solution) const override;

 private:
  void ComputeGradient(const LinearModel& model);
  double CauchyStep(LinearModel* model);
  Status ComputeGaussNewtonStep(LinearModel* model, int* num_solves);
  void ChooseWithinRadius(LinearModel* model, double* step);
  void FollowTraditionalPath(double alpha, const LinearModel& model);

  const std::vector<double>* scale_ = nullptr;
  double radius_ = 0.0;
  double min_diagonal_ = 0.0;
  double max_diagonal_ = 0.0;
  double mu_ = 0.0;
  bool reuse_ = false;
  std::optional<double> alpha_;  // length of the Cauchy step along −g̃, once it is needed
  double step_norm_ = 0.0;       // ‖w δ‖ of the last step
  double gauss_newton_norm_ = 0.0;
  std::vector<double> w_;
  std::vector<double> gradient_;      // g̃
  std::vector<double> gauss_newton_;  // w δ_gn
  std::vector<double> scratch_;
  std::vector<double> p_;                   // the step in the metric
  std::optional<DoglegSubspace> subspace_;  // if that is the kind
};

}  // namespace inceres::internal
