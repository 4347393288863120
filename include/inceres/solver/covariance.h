#pragma once

#include <map>
#include <utility>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"

namespace inceres {

class IncrementalSolver;

/// Options of Covariance.
struct INCERES_EXPORT CovarianceOptions {
  int num_threads = 1;  ///< ≥ 1: evaluation; the result is the same to the last bit
  /// > 1: a variance that exceeds the one with all else known by more than this factor counts as
  /// infinite. At 1e12 four digits are left of it.
  double max_inflation = 1e12;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

/// Covariances of estimates, in their tangent spaces: blocks of H⁻¹ = (JᵀJ)⁻¹ at the current
/// values, with Jacobians corrected for robust losses (and pinned where variables are), undamped.
/// With S = C − W P⁻¹ Wᵀ,
///
///     cov(a, b) = V_aᵀ S⁻¹ V_b + [a = b is a landmark] P_b⁻¹,    V = E_a of a frame, −W P⁻¹ of a landmark,
///
/// so a frame or landmark costs as many solves with the factor of S as it has degrees of freedom,
/// whatever sees it. Of factors that are whitened; otherwise it is a multiple.
///
/// What is not determined has no covariance: a free gauge, or a landmark without enough views
/// anywhere in the problem, is kSingular with the variable, not a large number. Through H, not J: a
/// stiff factor of 1e14 beside weak ones of 1e-2 that it ties together exceeds max_inflation.
///
/// Cost: one linearization, elimination and factorization of the whole problem, then the solves.
/// One caller; threads as options say. Source: Triggs et al. 1999, section 9;
/// docs/visual_inertial.md.
class INCERES_EXPORT Covariance {
 public:
  /// Pairs of variables, in either order.
  using Pairs = std::vector<std::pair<VariableId, VariableId>>;

  /// Holds no covariances yet.
  explicit Covariance(const CovarianceOptions& options = {}) : options_(options) {}

  /// Computes the blocks of these pairs, in one or the other order, and forgets all others. Blocks
  /// of constants are zero, as in Ceres. On an error there are none: an id that does not exist or
  /// that no factor touches is kInvalidArgument.
  Status Compute(const FactorGraph& graph, const Pairs& pairs);
  /// Of what the solver holds now.
  Status Compute(const IncrementalSolver& solver, const Pairs& pairs);

  /// Writes cov(a, b), row-major, tangent sizes of a × b. False if it was not computed.
  bool Get(VariableId a, VariableId b, double* covariance) const;

 private:
  Status ComputeAt(const FactorGraph& graph, const std::vector<double>& state, const Pairs& pairs);

  struct Block {
    int rows = 0;
    int columns = 0;
    std::vector<double> values;  // row-major
  };
  CovarianceOptions options_;
  std::map<std::pair<VariableId, VariableId>, Block> blocks_;
};

}  // namespace inceres
