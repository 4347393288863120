#include "incremental/running_cost.h"

#include <cmath>
#include <limits>

namespace inceres::internal {
namespace {

// Fall of the cost below its peak at which it is summed anew: rounding of the peak would be a share
// of what is left.
constexpr double kResumFall = 1e4;

// Operations on numbers of full size that a residual is taken to come of.
constexpr double kOperations = 16.0;

}  // namespace

void RunningCost::Resum(const std::vector<IncrementalFamily>& families, int num_factors) {
  if (num_changes_ <= num_factors && peak_ <= kResumFall * value_) {
    return;
  }
  num_changes_ = 0;
  value_ = 0.0;
  for (const IncrementalFamily& family : families) {
    // By family and place: the same order whenever it is summed, so the same bits.
    for (std::int32_t i = 0; i < family.num_places(); ++i) {
      value_ += family.weighed().linearized(i) ? family.weighed().Cost(i) : 0.0;
    }
  }
  peak_ = value_;
}

// F_ε = ½ (16 ε)² Σ_v ‖x_v‖_∞² tr C_vv (docs/algorithms.md, "Stopping rule").
double RoundingOfCost(const FactorGraph& graph, const VariableStore& variables,
                      const IncrementalSchur& schur) {
  const auto share = [&](VariableId id, int size, const auto& diagonal) {
    double trace = 0.0;
    for (int k = 0; k < size; ++k) {
      trace += diagonal(k);
    }
    double largest = 0.0;
    for (int k = 0; k < graph.AmbientSize(id); ++k) {
      largest = std::max(largest, std::fabs(variables.current(id)[k]));
    }
    return trace * largest * largest;
  };
  double sum = 0.0;
  for (int i = 0; i < static_cast<int>(schur.frames().size()); ++i) {
    const IncrementalSchur::Frame& frame = schur.frames()[i];
    if (frame.id >= 0 && !frame.held) {
      const double* C = schur.FrameDiagonal(i);
      sum += share(frame.id, frame.size, [C](int k) { return C[k]; });
    }
  }
  // No frame can move, and the landmarks' own factors are all that blurs the cost.
  const bool landmarks_only = sum == 0.0;
  for (int l = 0; landmarks_only && l < static_cast<int>(schur.landmarks().size()); ++l) {
    const IncrementalSchur::Landmark& landmark = schur.landmarks()[l];
    if (landmark.id >= 0 && schur.IsInS(l)) {
      const double* P = schur.blocks().P(l);
      sum += share(landmark.id, landmark.size, [P](int k) { return P[k * kQuad + k]; });
    }
  }
  const double rounding = kOperations * std::numeric_limits<double>::epsilon();
  return 0.5 * rounding * rounding * sum;
}

}  // namespace inceres::internal
