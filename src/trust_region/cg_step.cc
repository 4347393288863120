#include "trust_region/cg_step.h"

#include <vector>

namespace inceres::internal {

// Conjugate gradients with the rules of Ceres 2.1 for when they end and what their end means
// (docs/ceres_contract.md, "Conjugate gradients"). The iteration itself is ConjugateGradients; here
// its ends are translated. They fall into two kinds: those that leave an x, which the gain ratio
// will judge like any other step, and those that leave none, which make the step invalid and raise
// the damping.

namespace {

constexpr int kResidualResetPeriod = 10;  // Ceres's

}  // namespace

bool IsGoodEnoughForCeres(const ConjugateGradients& iteration, int min_iterations, double eta) {
  // Q = −decrease, and the signs cancel: k (Q_k − Q_{k−1}) / Q_k is the last gain over the mean of
  // all.
  const std::vector<double>& gains = iteration.gains();
  const auto count = static_cast<int>(gains.size());
  // A NaN ends nothing here; Iterate finds it in the next rᵀz.
  return count >= min_iterations && count * gains.back() / iteration.decrease() < eta;
}

Status IterateAsCeres(ConjugateGradients::System* system, int max_iterations, int min_iterations,
                      double eta, ConjugateGradients* iteration, CgOutcome* outcome) {
  using End = ConjugateGradients::End;
  iteration->StartFromZero();
  const End end = iteration->Iterate(system, max_iterations, kResidualResetPeriod);
  // One gain an iteration: a direction without curvature has added none.
  outcome->num_iterations = static_cast<int>(iteration->gains().size());
  // Iterate also ends, as converged, where rᵀM⁻¹r is zero. For b = 0 that is before the first
  // iteration, and x = 0 is the step. Later on it is what Ceres calls a numerical failure, unless
  // its own test holds at the same time.
  outcome->converged =
      end == End::kConverged &&
      (outcome->num_iterations == 0 || IsGoodEnoughForCeres(*iteration, min_iterations, eta));
  if (end == End::kBreakdown || (end == End::kConverged && !outcome->converged)) {
    ++outcome->num_iterations;  // the one that cannot be
    return Status::Error(StatusCode::kSingular,
                         "conjugate gradients: the residual or a curvature is zero or no number");
  }
  // Ceres counts the iteration that met the direction as well. x is what those before have made of
  // it, and counts as a step.
  outcome->num_iterations += end == End::kNotPositiveDefinite ? 1 : 0;
  return Status::Ok();
}

}  // namespace inceres::internal
