// Ceres's inner iterations: a member of TrustRegionMinimizer.
#include <vector>

#include "trust_region/trust_region_minimizer.h"

namespace inceres::internal {

// A round of coordinate descent from the candidate. What it gains counts as promised, for it says
// nothing about the step's model; a step after which it leaves less than there was before is taken
// whatever the ratio of both. A candidate whose end cannot be evaluated is taken back to where the
// round began.
void TrustRegionMinimizer::DescendByCoordinates() {
  descent_was_useful_ = false;
  if (coordinate_descent_ == nullptr || !HasCandidate()) {
    return;
  }
  InnerDescent& inner = *loop_.inner_descent;
  const double start = clock_.Read();
  ++inner.num_rounds;
  std::vector<double>& candidate = evaluator_.points().mutable_candidate();
  const std::vector<double> before = candidate;
  coordinate_descent_->Run();
  double cost = 0.0;
  if (!EvaluateCandidate(&cost)) {
    candidate = before;
    // they were those of the point that failed
    static_cast<void>(evaluator_.points().ComputeCandidateTangents());
    return;
  }
  model_decrease_ += candidate_cost_ - cost;
  iteration_.model_cost_change = model_decrease_;
  descent_was_useful_ = cost < cost_;
  if (!(1.0 - cost / candidate_cost_ > inner.tolerance)) {
    coordinate_descent_.reset();
  }
  candidate_cost_ = cost;
  inner.seconds += clock_.Read() - start;
}

}  // namespace inceres::internal
