#pragma once

#include "inceres/solver/gnc.h"

namespace inceres::internal {

/// The control parameter μ of graduated non-convexity and the weights that it gives, of s = ‖f‖²/c²
/// (GncSummary's SolveGnc has the equations). 0: the graduation has not begun.
class GncSchedule {
 public:
  GncSchedule(GncKernel kernel, double step) : kernel_(kernel), step_(step) {}

  /// Where the cost of suspects up to `largest` is convex. False, μ then 0, if all of them are
  /// inliers of the last cost already.
  bool Begin(double largest);
  /// One step toward the last cost.
  void Advance();
  /// Begins anew as if there were only suspects up to `largest`, if that is further on.
  void SkipTo(double largest);
  /// Whether μ is that of the last cost: Geman–McClure's at 1; truncated least squares' only when
  /// no weight is between 0 and 1 any more, which the weights tell.
  bool IsLast() const { return kernel_ == GncKernel::kGemanMcClure && mu_ <= 1.0; }
  /// In [0, 1].
  double Weight(double s) const;
  /// Of the last cost itself.
  double LastWeight(double s) const;

  double mu() const { return mu_; }
  GncKernel kernel() const { return kernel_; }

 private:
  GncKernel kernel_;
  double step_;
  double mu_ = 0.0;
};

}  // namespace inceres::internal
