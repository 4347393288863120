#pragma once

#include <cstddef>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"

namespace inceres {

/// Which normal equations IncrementalSolver::Covariance inverts.
enum class CovarianceAccuracy {
  /// S as the last Update factored it, damped, with the Jacobians it has. The cheapest; variances
  /// are too small by up to FactorStaleness::damping_error, which in a large graph held at one end
  /// is much.
  kAsFactored,
  /// S without the damping of the frames: a second factor is kept for it, clique by clique, of
  /// which a call renews what has changed since the one before. A few changed rows, such as those
  /// of poses along the odometry, wait until they are more: products around them are nearly as
  /// exact. Landmarks keep their damping, 1e-6 or more unless a claim of convergence has asked for
  /// less: FactorStaleness::damping_error tells how much of a variance that takes, found to 1 %.
  kUndamped,
  /// The undamped normal equations at the values held now, all factors linearized anew, by
  /// conjugate gradients with the Update's factor as preconditioner: what GraphCovariance computes.
  kExact,
};

/// Options of IncrementalSolver::Covariance.
struct INCERES_EXPORT LiveCovarianceOptions {
  CovarianceAccuracy accuracy = CovarianceAccuracy::kUndamped;  ///< what is inverted
  /// > 0, of kExact: the error of a variance, relative to it. Of a covariance relative to √(Σ_ii
  /// Σ_jj).
  double tolerance = 1e-10;
  int max_iterations = 200;  ///< ≥ 1, of kExact: for each column

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

/// How far the factor that covariances were taken from is from the undamped normal equations of the
/// values held now.
struct INCERES_EXPORT FactorStaleness {
  /// Factors of the variables concerned (of a frame those of its landmarks too) whose Jacobian is
  /// of other values than now and may differ there.
  int num_stale_factors = 0;
  /// Of these the largest √w ‖f − f̂‖: the error of an old linearization, in units of the residual.
  double largest_residual_error = 0.0;
  /// Of all factors: to be linearized anew by the next Update.
  int num_dirty_factors = 0;
  /// Rows of S that have changed since they were factored, for the Update was stopped in between.
  int num_changed_rows = 0;
  /// Largest entry of the step that the last Update saw and did not take, of the variables
  /// concerned, in the units of their tangent spaces.
  double largest_pending_step = 0.0;
  /// μ: diag(C) of the frames is increased by this share; 0 of kUndamped.
  double frame_damping = 0.0;
  /// The largest share by which the diagonal of P was increased, of the landmarks concerned and of
  /// those that frames concerned see.
  double landmark_damping = 0.0;
  /// By which share damping lowers a variance at most: 1 − λ / (λ + μ) (1 − θ), with λ the smallest
  /// eigenvalue of D^−½ S D^−½, D = diag(C), by inverse iteration, and θ the largest share that the
  /// landmarks' damping has of xᵀSx, by power iteration to 1 % of it; of a landmark's variance θ is
  /// increased by the share of its damping in its own block. Both are sought again when something
  /// was taken out of the graph or changed, and when the graph has grown by a tenth. Of kUndamped
  /// without μ, so that it is 0 where there are no landmarks; 0 of kExact.
  double damping_error = 0.0;
  int num_iterations = 0;       ///< of kExact: conjugate gradients, of all columns together
  int num_factored_frames = 0;  ///< of kUndamped: whose columns were factored anew for this call
};

/// The joint covariance of a few variables, in their tangent spaces.
struct INCERES_EXPORT LiveCovariance {
  std::vector<VariableId> variables;  ///< as asked for
  std::vector<int> offsets;           ///< first row of each, one more: the size
  std::vector<double> values;         ///< row-major, size × size, symmetric
  /// of the factor they were taken from; with kExact of the preconditioner
  FactorStaleness staleness;

  /// Rows, and columns.
  int size() const { return offsets.empty() ? 0 : offsets.back(); }
  /// An entry.
  double operator()(int row, int column) const {
    return values[static_cast<std::size_t>(row) * static_cast<std::size_t>(size()) +
                  static_cast<std::size_t>(column)];
  }
};

}  // namespace inceres
