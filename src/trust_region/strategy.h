#pragma once

#include <memory>
#include <vector>

#include "inceres/solver/options.h"
#include "trust_region/linear_model.h"

namespace inceres::internal {

/// Whether a kind's radius is one over the damping of its steps.
inline bool IsDamped(TrustRegionStrategyKind kind) {
  return kind == TrustRegionStrategyKind::kLevenbergMarquardt ||
         kind == TrustRegionStrategyKind::kMarquardt;
}

/// Computes steps from a linear model and moves its own damping or radius by how well they did.
/// Exact mode: Ceres 2.1's constants and order of operations, restated without scaling J
/// (docs/ceres_contract.md, "Levenberg–Marquardt" and "Dog-Leg").
class TrustRegionStrategy {
 public:
  virtual ~TrustRegionStrategy() = default;

  virtual bool Serves(TrustRegionStrategyKind kind) const = 0;

  /// Before the first step of a solve; nothing of an earlier solve is left but memory. `scale`
  /// stays where it is until the next.
  virtual void Start(const SolverOptions& options, const std::vector<double>& scale) = 0;

  /// The next step (packed). kSingular: there is none at this damping, an invalid step. *num_solves
  /// counts linear solves.
  virtual Status ComputeStep(LinearModel* model, double* step, int* num_solves) = 0;

  virtual void StepAccepted(double quality) = 0;
  virtual void StepRejected() = 0;
  virtual void StepIsInvalid() = 0;
  virtual double Radius() const = 0;
  /// What the damping Λ holds back of the last step δ, δᵀΛδ; infinite where a radius has cut it. An
  /// entry that is damped more than it would be in a solve that began here counts as many times. A
  /// direction that Λ outweighs gains about this much in each step, and none tells how many more
  /// there are to come.
  virtual double HeldBack(const LinearModel& model, const std::vector<double>& step) = 0;
  /// Of the last linear solve its damping, and its solution where that is not the step
  /// (StepSystem).
  virtual void GetLastSolve(std::vector<double>* damping, std::vector<double>* solution) const = 0;
  /// The next step is to be damped by no more than this radius allows; if it is refused, what was
  /// is again.
  virtual void Widen(double /*radius*/) {}
  /// Entries of steps that are zero from now on, by flags; empty: none.
  virtual void Hold(const std::vector<char>& /*held*/) {}
  /// What it has learned from steps, and to go on with that of another one, started alike.
  virtual std::vector<double> Save() const = 0;
  virtual bool Restore(const std::vector<double>& saved) = 0;
  /// This radius from now on, and nothing of what steps before have taught; 0: all as it is.
  virtual void Restart(double /*radius*/) {}
};

/// s_j = 1/(1 + ‖J_j‖) as measured at iteration 0, or all ones; a norm counts as `most_norm` at
/// most.
void JacobiScale(const std::vector<double>& diagonal, bool jacobi_scaling, double most_norm,
                 std::vector<double>* scale);

/// Starts the strategy that the options ask for: *strategy, if that is of the kind, or a new one in
/// its place.
void StartStrategy(const SolverOptions& options, const std::vector<double>& scale,
                   std::unique_ptr<TrustRegionStrategy>* strategy);

}  // namespace inceres::internal
