#include "trust_region/conjugate_gradients_model.h"

namespace inceres::internal {

// Conjugate gradients with the rules of Ceres 2.1 for when they end and what their end means
// (docs/ceres_contract.md, "Conjugate gradients"). The iteration itself is ConjugateGradients; here
// its ends are translated. They fall into two kinds: those that leave an x, which the gain ratio
// will judge like any other step, and those that leave none, which make the step invalid and raise
// the damping.

namespace {

constexpr int kResidualResetPeriod = 10;  // Ceres's

}  // namespace

// A system without unknowns takes no iteration, and is solved.
void ConjugateGradientsModel::BeginStep(const double* damping) {
  damping_ = damping;
  num_iterations_ = 0;
  converged_ = true;
  leaves_landmarks_ = false;
}

// Asked by the iteration after each step it takes.
bool ConjugateGradientsModel::IsGoodEnough(const ConjugateGradients& iteration) const {
  // Q = −decrease, and the signs cancel: k (Q_k − Q_{k−1}) / Q_k is the last gain over the mean of
  // all.
  const std::vector<double>& gains = iteration.gains();
  const auto count = static_cast<int>(gains.size());
  // A NaN ends nothing here; Iterate finds it in the next rᵀz.
  return count >= options_.min_iterations && count * gains.back() / iteration.decrease() < eta_;
}

Status ConjugateGradientsModel::Iterate() {
  using End = ConjugateGradients::End;
  iteration_.StartFromZero();
  const End end = iteration_.Iterate(this, options_.max_iterations, kResidualResetPeriod);
  // One gain an iteration: a direction without curvature has added none.
  num_iterations_ = static_cast<int>(iteration_.gains().size());
  // Iterate also ends, as converged, where rᵀM⁻¹r is zero. For b = 0 that is before the first
  // iteration, and x = 0 is the step. Later on it is what Ceres calls a numerical failure, unless
  // its own test holds at the same time.
  converged_ = end == End::kConverged && (num_iterations_ == 0 || IsGoodEnough(iteration_));
  if (end == End::kBreakdown || (end == End::kConverged && !converged_)) {
    ++num_iterations_;  // the one that cannot be
    return Status::Error(StatusCode::kSingular,
                         "conjugate gradients: the residual or a curvature is zero or no number");
  }
  // Ceres counts the iteration that met the direction as well. x is what those before have made of
  // it, and counts as a step.
  num_iterations_ += end == End::kNotPositiveDefinite ? 1 : 0;
  return Status::Ok();
}

}  // namespace inceres::internal
