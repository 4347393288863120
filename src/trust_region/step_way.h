#pragma once

#include <array>
#include <memory>

#include "inceres/solver/options.h"
#include "linearize/evaluator.h"
#include "linearize/incidences.h"

namespace inceres::internal {

/// Ways to solve for the steps of a graph with landmarks: by a factor of S, or by conjugate
/// gradients with blocks of S or two levels as preconditioner, S formed or not.
enum class StepWay { kFactor, kBlocks, kBlocksOnS, kTwoLevel, kTwoLevelOnS };
inline constexpr int kNumStepWays = 5;

/// What a step takes each way, in flops of the dense Cholesky that take as long, and more where it
/// takes more steps; infinite where there is no memory for it.
struct StepCosts {
  std::array<double, kNumStepWays> of{};
  bool factor_is_bound = false;  ///< kFactor's: a bound from either side, which decides

  double& operator[](StepWay way) { return of[static_cast<std::size_t>(way)]; }
  double operator[](StepWay way) const { return of[static_cast<std::size_t>(way)]; }
  /// The cheapest, of equals the first; a factor where the others are not cheaper by far.
  StepWay Cheapest() const;
};

/// Predicts from connections alone. Costs are right to what the constants are, but for kFactor's:
/// where a lower or an upper bound of it decides, that bound stands in its place. Cost: nothing
/// where even a full S is factored in the time of a few products, else that of the incidences, and,
/// where neither bound decides, as much as to form S once without its numbers, and a symbolic
/// analysis.
///
/// *incidences, unless null: those that were found on the way, for who needs them next; or nothing.
StepCosts PredictSteps(const Evaluator& evaluator,
                       std::unique_ptr<LandmarkIncidences>* incidences = nullptr);

/// The options of conjugate gradients that go this way, which is not kFactor.
ConjugateGradientsOptions OptionsOf(StepWay way, const ConjugateGradientsOptions& options);

}  // namespace inceres::internal
