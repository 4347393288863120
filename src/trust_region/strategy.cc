#include "trust_region/strategy.h"

#include <algorithm>
#include <cmath>

#include "trust_region/dogleg.h"
#include "trust_region/levenberg_marquardt.h"

namespace inceres::internal {

// The choice of a strategy. Objects are kept from solve to solve for their memory, and started
// anew.

void JacobiScale(const std::vector<double>& diagonal, bool jacobi_scaling, double most_norm,
                 std::vector<double>* scale) {
  scale->assign(diagonal.size(), 1.0);
  // Ceres's jacobi_scaling: 1 + norm, so that columns of zeros have a finite scale.
  if (jacobi_scaling) {
    std::transform(diagonal.begin(), diagonal.end(), scale->begin(), [most_norm](double n2) {
      return 1.0 / (1.0 + std::min(most_norm, std::sqrt(n2)));
    });
  }
}

void StartStrategy(const SolverOptions& options, const std::vector<double>& scale,
                   std::unique_ptr<TrustRegionStrategy>* strategy) {
  // Both kinds of damped steps are one class, both kinds of Dog-Leg another.
  if (*strategy == nullptr || !(*strategy)->Serves(options.strategy)) {
    if (IsDamped(options.strategy)) {
      *strategy = std::make_unique<LevenbergMarquardt>();
    } else {
      *strategy = std::make_unique<Dogleg>();
    }
  }
  (*strategy)->Start(options, scale);
}

}  // namespace inceres::internal
