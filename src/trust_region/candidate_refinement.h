#pragma once

#include <memory>
#include <optional>

#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"
#include "schur/inner_iterations.h"
#include "trust_region/coordinate_descent.h"
#include "trust_region/loop_evaluation.h"
#include "trust_region/loop_options.h"

namespace inceres::internal {

/// What moves a candidate on before its step is judged: landmarks one by one, with the frames held
/// (ours), or rounds of coordinate descent (Ceres's inner iterations). What either gains counts as
/// promised, as in Ceres: it says nothing about the step's model.
class CandidateRefinement {
 public:
  /// What the options ask for, which may be neither. All of them outlive this.
  CandidateRefinement(const SolverOptions& options, const LoopOptions& loop,
                      LoopEvaluation* evaluation, Summary* summary);

  bool RefinesLandmarks() const { return inner_iterations_ != nullptr; }
  bool Descends() const { return coordinate_descent_ != nullptr; }

  /// Landmarks move by themselves, where that is worth it after a step from `cost` to
  /// `candidate_cost`; what they have gained.
  double RefineLandmarks(double cost, double candidate_cost);
  /// A round of coordinate descent from where it costs so much; what it costs afterwards. None: the
  /// end of the round cannot be evaluated, and the candidate is where it was.
  std::optional<double> Descend(double candidate_cost);

 private:
  const SolverOptions& options_;
  const LoopOptions& loop_;
  LoopEvaluation& evaluation_;
  Summary& summary_;
  std::unique_ptr<InnerIterations> inner_iterations_;      // null: none
  std::unique_ptr<CoordinateDescent> coordinate_descent_;  // null: none, or no more
};

}  // namespace inceres::internal
