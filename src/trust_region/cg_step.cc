#include "trust_region/cg_step.h"

#include <vector>

namespace inceres::internal {
namespace {

constexpr int kResidualResetPeriod = 10;  // Ceres's

}  // namespace

bool IsGoodEnoughForCeres(const ConjugateGradients& iteration, int min_iterations, double eta) {
  const std::vector<double>& gains = iteration.gains();
  const auto count = static_cast<int>(gains.size());
  return count >= min_iterations && count * gains.back() / iteration.decrease() < eta;
}

Status IterateAsCeres(ConjugateGradients::System* system, int max_iterations, int min_iterations,
                      double eta, ConjugateGradients* iteration, CgOutcome* outcome) {
  using End = ConjugateGradients::End;
  iteration->StartFromZero();
  const End end = iteration->Iterate(system, max_iterations, kResidualResetPeriod);
  outcome->num_iterations = static_cast<int>(iteration->gains().size());
  outcome->converged =
      end == End::kConverged &&
      (outcome->num_iterations == 0 || IsGoodEnoughForCeres(*iteration, min_iterations, eta));
  if (end == End::kBreakdown || (end == End::kConverged && !outcome->converged)) {
    ++outcome->num_iterations;  // the one that cannot be
    return Status::Error(StatusCode::kSingular,
                         "conjugate gradients: the residual or a curvature is zero or no number");
  }
  outcome->num_iterations += end == End::kNotPositiveDefinite ? 1 : 0;
  return Status::Ok();
}

}  // namespace inceres::internal
