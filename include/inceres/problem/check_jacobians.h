#pragma once

#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/manifolds.h"
#include "inceres/status.h"

namespace inceres {

/// Options of CheckJacobians.
struct INCERES_EXPORT JacobianCheckOptions {
  /// > 0: an entry is wrong if it is further from the numeric derivative than this share of the
  /// largest entry of its row (over all slots), and than the numeric derivative's own error.
  double tolerance = 1e-6;
  /// > 0: the first step, as a share of the largest value of the variable, at least of 1: of the
  /// tangent vector's scalar, one after the other. Later ones are smaller.
  double relative_step = 1e-2;
  /// ≥ 1: of each family so many factors are looked at, spread over it evenly.
  int max_factors = 1000;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

/// An entry of the tangent Jacobian of a factor, and what it should be.
struct JacobianEntry {
  FamilyId family = -1;         ///< −1 where no graph was given
  int factor = -1;              ///< index in its family; −1: none
  int slot = -1;                ///< of the variable
  int row = -1;                 ///< of the residual
  int column = -1;              ///< of the tangent vector of the slot's variable
  double analytic = 0.0;        ///< what the family has written
  double numeric = 0.0;         ///< the derivative of its residual
  double numeric_error = 0.0;   ///< estimated, of the latter
  double relative_error = 0.0;  ///< |analytic − numeric| as a share of the row's largest entry
};

/// What CheckJacobians found.
struct INCERES_EXPORT JacobianReport {
  /// kEvaluationFailed, with the factor, if one could not be evaluated; kInvalidArgument if there
  /// is no such family or the options are wrong. What follows is then of no use.
  Status status;
  int num_factors = 0;  ///< that were checked
  int num_entries = 0;  ///< that were compared
  int num_wrong = 0;    ///< entries that are wrong
  /// Entries that differ by more than the tolerance, but by no more than the numeric derivative may
  /// err: at a kink, or where residuals are so large that nothing can be said. Look at other
  /// values.
  int num_uncertain = 0;
  /// Of the wrong entries, or else of all, that of the largest relative error; factor −1 if there
  /// are none.
  JacobianEntry worst;
  std::string factor_name;  ///< of worst, as error messages call it

  /// Whether all could be checked, and none is wrong.
  bool ok() const { return status.ok() && num_wrong == 0; }
  /// "2 of 24 entries wrong, in 2 factors; worst: factor 0 of BAL reprojection (variables 3, 112),
  /// slot 1, row 0, column 2: 3 where the numeric derivative is 4.5", or why nothing could be said.
  std::string ToString() const;
};

/// Compares the Jacobians that a family writes with derivatives of its residuals, at the values of
/// a graph and in the tangent spaces of its variables: what every factor of your own should pass,
/// at several values, before it is solved with. Of constants too, as if they were not; not of what
/// is borrowed, has no tangent space, or another one than the slot (FactorFamily::Space).
///
///     J_analytic  ≟  ∂f(x ⊞ δ)/∂δ  at δ = 0
///
/// by Ridders' method: central differences at steps that shrink by 1.4, extrapolated to a step of
/// 0, with an estimate of the error; steps where a residual cannot be evaluated are made smaller.
/// Robust losses play no part. A LinearPriorFamily is right only where it was linearized, as its
/// documentation says.
///
/// Cost: 20 cost-only evaluations a factor and tangent scalar. Calls the family on the calling
/// thread only; changes nothing. Source: Ridders, "Accurate computation of F'(x) and F'(x)F''(x)",
/// 1982.
INCERES_EXPORT JacobianReport CheckJacobians(const FactorGraph& graph, FamilyId family,
                                             const JacobianCheckOptions& options = {});
/// Of all families of a graph.
INCERES_EXPORT JacobianReport CheckJacobians(const FactorGraph& graph,
                                             const JacobianCheckOptions& options = {});
/// The same for one factor of a family that is in no graph, at values given a slot each, of the
/// ambient sizes of the slots, with the manifolds of its variables: one a slot, null for Euclidean,
/// or none at all if all are.
INCERES_EXPORT JacobianReport CheckJacobians(const FactorFamily& family, int factor,
                                             const std::vector<const double*>& values,
                                             const std::vector<const Manifold*>& manifolds = {},
                                             const JacobianCheckOptions& options = {});

}  // namespace inceres
