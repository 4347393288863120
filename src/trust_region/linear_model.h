#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <vector>

#include "base/stopwatch.h"
#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "linearize/evaluator.h"
#include "linearize/row_products.h"
#include "trust_region/step_way.h"

namespace inceres::internal {

/// True if every entry of a step is finite.
inline bool IsFinite(const std::vector<double>& step) {
  return std::all_of(step.begin(), step.end(), [](double entry) { return std::isfinite(entry); });
}

/// The local model every strategy drives: ½‖f + Jδ‖² at the evaluator's current point, however it
/// is represented. Vectors are packed tangent vectors (frames, then landmarks). H is never damped
/// or scaled; damping is an argument of Solve.
class LinearModel {
 public:
  virtual ~LinearModel() = default;

  /// Where the stages' times are added from now on, by a clock that has just been read when a stage
  /// begins.
  void TimeInto(StageSeconds* seconds, StageClock* clock) {
    seconds_ = seconds;
    clock_ = clock;
  }

  /// Ahead of the first Refresh of each solve: a model that has served another one forgets what it
  /// has learned there, so that no solve depends on those before.
  virtual void BeginSolve() {}

  /// Takes over the evaluator's new residuals and Jacobians.
  virtual void Refresh() = 0;

  /// g = Jᵀf.
  virtual const std::vector<double>& Gradient() const = 0;

  /// diag(H): the squared column norms of J.
  virtual const std::vector<double>& Diagonal() const = 0;

  /// Solves (H + diag(damping)) δ = −g. kSingular if there is no such step; the model is then
  /// unchanged.
  virtual Status Solve(const double* damping, double* step) = 0;

  /// The scale of J's columns, for models that depend on it; stays where it is until the next.
  virtual void ScaleColumnsBy(const std::vector<double>& /*scale*/) {}

  /// Whether steps come from conjugate gradients alone.
  virtual bool is_iterative() const { return false; }

  /// Of the last Solve; 1 of a direct one.
  virtual int num_iterations() const { return 1; }

  /// Whether the last Solve has left landmarks where they are (ConjugateGradientsOptions).
  virtual bool left_out_landmarks() const { return false; }

  /// The frames of the layout in the order in which the factor of a direct solver eliminates them;
  /// empty where there is none of which that is known.
  virtual std::vector<int> EliminationOrder() const { return {}; }

  /// Name of what solves the (reduced) system.
  virtual const char* SolverName() const = 0;

  /// Adds the model's sizes and bytes to the counts.
  virtual void Describe(WorkCounts* work) const = 0;

  /// aᵀb of two packed vectors, and whether all entries of one are finite. Of a model that several
  /// processes have a part of: over all of it, and the same in each.
  virtual double Dot(const std::vector<double>& a, const std::vector<double>& b) const {
    return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
  }
  virtual bool IsFinite(const std::vector<double>& v) const { return internal::IsFinite(v); }

  /// vᵀHv = ‖Jv‖².
  double Quadratic(const double* v) { return MultiplyJacobian(v).squared_norm; }

  /// L(0) − L(v) = −(Jv)ᵀ(f + Jv/2), as a pass over J: near the optimum its sign decides, and the
  /// cheaper ηᵀv − ½vᵀHv cancels.
  double ModelDecrease(const double* v) { return MultiplyJacobian(v).model_decrease; }

 protected:
  explicit LinearModel(const Evaluator& evaluator) : evaluator_(evaluator), jacobian_(evaluator) {}

  /// What a pass over J yields for v.
  virtual RowProducts MultiplyJacobian(const double* v) { return jacobian_.Multiply(v); }
  JacobianProduct& jacobian() { return jacobian_; }

  const Evaluator& evaluator_;
  StageSeconds* seconds_ = nullptr;
  StageClock* clock_ = nullptr;

 private:
  JacobianProduct jacobian_;
};

/// How steps are solved for where options leave that to the solver, by connections alone
/// (PredictSteps, which may find incidences); else kFactor.
StepWay ChooseStepWay(const SolverOptions& options, const Evaluator& evaluator,
                      std::unique_ptr<LandmarkIncidences>* incidences);

/// Makes the model that options.linear_model asks for; kAutomatic means Schur where there are
/// landmarks, and `way`, which is ChooseStepWay's, where that is another. `eliminated` is
/// LoopOptions::eliminated, null mostly; `incidences` those of the evaluator, if there are any yet.
/// It wants TimeInto before its first use. Fails if the reduced solver cannot be set up.
std::unique_ptr<LinearModel> MakeLinearModel(const SolverOptions& options, StepWay way,
                                             const Evaluator& evaluator,
                                             const std::vector<VariableId>* eliminated,
                                             std::unique_ptr<LandmarkIncidences> incidences,
                                             Status* status);

}  // namespace inceres::internal
