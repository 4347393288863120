#pragma once

#include "inceres/export.h"

namespace inceres {

/// A robust loss ρ(s) of the squared residual norm s = ‖f‖²; a factor costs ½ρ(s). Null means ρ(s) = s.
///
/// The built-in losses are in graph/losses.h. Evaluate is called concurrently when the solver runs with several threads.
/// Source: Triggs et al., "Bundle Adjustment — A Modern Synthesis", 1999, section 4.3.
class INCERES_EXPORT Loss {
 public:
  virtual ~Loss() = default;

  /// rho[0] = ρ(s), rho[1] = ρ'(s), rho[2] = ρ''(s), for s ≥ 0. Requires ρ(0) = 0 and ρ' > 0 where ρ'' > 0.
  virtual void Evaluate(double s, double rho[3]) const = 0;
};

}  // namespace inceres
