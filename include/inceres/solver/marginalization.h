#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/manifolds.h"
#include "inceres/status.h"

namespace inceres {

/// What is left of factors and variables that were marginalized: a square-root prior on their
/// neighbors x_1 … x_k, linearized once and for all at x₀,
///
///     e(x) = e₀ + J δ,   δ = (x_1 ⊟ x₀_1, …, x_k ⊟ x₀_k).
///
/// JᵀJ is its information, −Jᵀe₀ its right-hand side at x₀. J has as many rows as columns, rows of
/// zeros included.
struct INCERES_EXPORT LinearPrior {
  /// One variable of the prior.
  struct Block {
    std::vector<double> x0;                    ///< linearization point, ambient size
    std::shared_ptr<const Manifold> manifold;  ///< null: Euclidean
    int tangent_size = 0;                      ///< of the manifold, or x0.size()
  };
  std::vector<Block> blocks;  ///< x_1 … x_k
  std::vector<double> J;      ///< row-major, e0.size() × Σ tangent_size, whitened
  std::vector<double> e0;     ///< whitened

  /// Σ tangent_size over the blocks.
  int num_columns() const;
};

/// The factors that LinearPriors are: one slot a block. A family holds priors of one shape: the
/// same number of rows and the same sizes, block by block.
///
/// The tangent Jacobian is J itself, at every x: the first-estimate Jacobian, which is a choice and
/// not the derivative of e once a rotation has moved from x₀. (VINS and OKVIS make the same one.)
/// It holds for ⊞ of vector spaces and groups, whose tangent coordinates at x and x₀ mean the same;
/// those of a SphereManifold do not after a large move. Fails to evaluate where an x ⊟ x₀ is
/// undefined or a residual is not finite.
///
/// Cost: rows × columns multiplications a factor, a copy of J for Jacobians; nothing allocated up
/// to 256 columns. JᵀJ is formed once by the incremental solver (HasConstantJacobian). Threads: as
/// FactorFamily; Place is for one writer. Source: Leutenegger et al., "Keyframe-based
/// visual–inertial odometry using nonlinear optimization", 2015, section 3.5.
class INCERES_EXPORT LinearPriorFamily : public FactorFamily {
 public:
  /// What Add and Place take.
  using Measurement = LinearPrior;

  /// For priors of the shape of this one.
  explicit LinearPriorFamily(const LinearPrior& shape);

  /// Whether a prior has the family's shape.
  bool Fits(const LinearPrior& prior) const;
  /// Requires a prior that fits.
  void Add(const LinearPrior& prior) { Place(size(), prior); }
  /// Overwrites the prior at `index`, or appends it if index == size(). Requires a prior that fits.
  void Place(int index, const LinearPrior& prior);
  /// The prior at an index.
  const LinearPrior& prior(int index) const { return priors_[static_cast<std::size_t>(index)]; }

  int size() const override { return static_cast<int>(priors_.size()); }
  const char* Name() const override { return "linear prior"; }
  EvaluationFailure Evaluate(const FactorBatch& batch) const override;
  bool HasConstantJacobian() const override { return true; }

 private:
  EvaluationFailure EvaluateOne(int i, const FactorBatch& batch, double* delta) const;

  int num_columns_;
  std::vector<LinearPrior> priors_;
};

/// The prior that a factor of a graph is; null if it is of another kind, or there is no such
/// factor.
INCERES_EXPORT const LinearPrior* FindLinearPrior(const FactorGraph& graph, FactorId factor);

/// Which directions of a prior are cut off as noise: those whose eigenvalue λ of its information
/// JᵀJ is small.
enum class PriorThreshold {
  /// none: the QR factor is kept as it is, which is exact; directions without information are rows
  /// of zeros
  kNone,
  kAbsolute,  ///< λ ≤ epsilon (VINS: 1e-8)
  /// λ ≤ epsilon · n · λ_max of the matrix scaled to a unit diagonal (OKVIS: epsilon of double)
  kRelative,
};

/// Options of Marginalize.
struct INCERES_EXPORT MarginalizationOptions {
  PriorThreshold threshold = PriorThreshold::kNone;  ///< which directions count as noise
  double epsilon = 1e-8;                             ///< of the threshold, ≥ 0
  /// A marginalized variable with a direction that no factor measures makes the call fail with its
  /// id. If allowed, what is measured is used and the rest left out, which is the same as the
  /// pseudo-inverse of VINS and OKVIS: right for the others, to whom a point seen once says
  /// nothing.
  bool allow_rank_loss = false;
  /// In [0, 1): a column of the marginalized variables counts as unmeasured when elimination leaves
  /// less than this share of it.
  double rank_tolerance = 1e-12;
  /// Constants among the neighbors are exactly known to a prior, which says nothing about them if
  /// they are set free later. If kept, their columns are part of it (as VINS keeps its extrinsics);
  /// borrowed constants never are. One whose degrees of freedom are not those of its slots is
  /// refused.
  bool keep_constants = false;
  /// Pins the variables that the prior keeps to where they are linearized now
  /// (FactorGraph::PinLinearization), but for those pinned before.
  bool first_estimate_jacobians = false;

  /// What is wrong with these options, the first culprit named.
  Status Validate() const;
};

/// What goes, and how. Nothing may be named twice.
struct INCERES_EXPORT MarginalizationRequest {
  /// removed; what their factors say about others becomes a prior
  std::vector<VariableId> marginalized;
  std::vector<VariableId> dropped;  ///< removed with all their factors, whose information is lost
  std::vector<FactorId> dropped_factors;  ///< removed, their information lost
  /// The prior's order: variables named here come first, in this order, where the prior has them;
  /// then the others by id.
  std::vector<VariableId> order;
};

/// What Marginalize did.
struct INCERES_EXPORT MarginalizationSummary {
  Status status;  ///< not ok: nothing has changed
  /// of a status that is not ok: the ids at fault, where there are any
  std::vector<VariableId> offenders;
  /// the new factor; family -1 if nothing is left to say or nobody to say it about
  FactorId prior;
  std::vector<VariableId> kept;  ///< the prior's variables in its order
  int rank = 0;                  ///< rows of the prior that say something
  int num_truncated = 0;         ///< directions cut off by the threshold
  int num_factors = 0;           ///< that went into the prior
  int num_cached_factors = 0;    ///< of them with the Jacobians of a live solver, not evaluated
  /// ½‖·‖² of their residuals that no variable can change any more: the cost falls by it
  double fixed_cost = 0.0;
};

/// Takes variables out of a graph and keeps what their factors say about the neighbors r as one
/// LinearPrior factor: with the marginalized ones m,
///
///     JᵀJ = H_rr − H_rm H_mm⁻¹ H_mr,   −Jᵀe₀ = η_r − H_rm H_mm⁻¹ η_m,
///
/// by QR of the stacked Jacobians [J_m J_r f], landmarks first with one small QR each, then frames;
/// H is never formed, so a factor of weight 1e14 beside one of 1e-2 costs no digits. Residuals and
/// Jacobians are taken at the current values (Jacobians of pinned variables where they are pinned),
/// corrected for robust losses as the solver does; damping plays no part. J stays what it is
/// (LinearPriorFamily).
///
/// A transaction: on an error nothing has changed. kInvalidArgument: an id or option is wrong, or
/// the prior would join two landmarks that are not constant (offenders: those; marginalize them
/// too, or drop their factors). kSingular: rank loss (offenders: the variables without enough
/// information; all landmarks at fault, or all frames). kEvaluationFailed: as in a solve. A
/// constant can be marginalized: it is fixed where it is. Free places that removed factors leave
/// are used again.
///
/// Priors of like shape share a family, so that a window that slides for ever does not grow.
///
/// Cost: rows · columns² of the factors and variables concerned, plus (this overload) one check of
/// the whole graph. One thread. Source: docs/visual_inertial.md; Leutenegger et al. 2015 and Qin,
/// Li & Shen, "VINS-Mono", 2018, for what it replaces.
INCERES_EXPORT MarginalizationSummary Marginalize(const MarginalizationRequest& request,
                                                  const MarginalizationOptions& options,
                                                  FactorGraph* graph);

/// \file
/// Which landmarks go with the frames that leave a window: three rules of known estimators, as
/// requests to Marginalize. None of them changes anything.
///
/// A frame is whatever does not have the role of a landmark: the poses, velocities and biases of
/// one image are given together. "Seen by" a frame: some factor touches both. What is constant or
/// borrowed among the landmarks stays where it is. Cost: the factors of the frames given and of the
/// landmarks they see; a pass over a copy of the graph if it does not track its variables' factors
/// yet, which after the first Marginalize it does.

/// The oldest frame leaves with all landmarks it sees: every factor of it goes into the prior.
/// Landmarks with fewer than min_factors factors (2 or more views, for a landmark and not just its
/// ray) are dropped instead. Source: VINS-Mono's MARGIN_OLD (Qin, Li & Shen, "VINS-Mono: A robust
/// and versatile monocular visual-inertial state estimator", 2018, section VI-C).
INCERES_EXPORT MarginalizationRequest OldestFrameRule(const FactorGraph& graph,
                                                      const std::vector<VariableId>& frames,
                                                      int min_factors = 2);

/// A frame leaves that is too like its neighbors to be worth its linearization: factors that tie it
/// to landmarks are dropped, and landmarks that have no others with them; what else touches it (the
/// prior, preintegrated motion) is marginalized. Source: VINS-Mono's MARGIN_SECOND_NEW.
INCERES_EXPORT MarginalizationRequest SecondNewestFrameRule(const FactorGraph& graph,
                                                            const std::vector<VariableId>& frames);

/// Landmarks the leaving frames see: one that a frame of `newest` sees too stays, and its factors
/// with the leaving frames are dropped, so that it stays out of the prior; any other is
/// marginalized, or dropped if it has fewer than min_factors factors. A landmark all of whose
/// factors touch a leaving frame, as an inverse depth does whose anchor leaves, cannot stay.
/// Source: Leutenegger et al., "Keyframe-based visual–inertial odometry using nonlinear
/// optimization", 2015, section 3.5 (OKVIS's applyMarginalizationStrategy).
INCERES_EXPORT MarginalizationRequest KeyframeRule(const FactorGraph& graph,
                                                   const std::vector<VariableId>& leaving,
                                                   const std::vector<VariableId>& newest,
                                                   int min_factors = 2);

}  // namespace inceres
