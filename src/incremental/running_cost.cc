#include "incremental/running_cost.h"

#include "linearize/cost_rounding.h"

namespace inceres::internal {
namespace {

// Fall of the cost below its peak at which it is summed anew: rounding of the peak would be a share
// of what is left.
constexpr double kResumFall = 1e4;

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

double RoundingOfCost(const FactorGraph& graph, const VariableStore& variables,
                      const IncrementalSchur& schur) {
  CostRounding rounding;
  const auto add = [&](VariableId id, int size, const auto& diagonal) {
    rounding.Add(variables.current(id), graph.AmbientSize(id), size, diagonal);
  };
  for (int i = 0; i < static_cast<int>(schur.frames().size()); ++i) {
    const IncrementalSchur::Frame& frame = schur.frames()[i];
    if (frame.id >= 0 && !frame.held) {
      const double* C = schur.FrameDiagonal(i);
      add(frame.id, frame.size, [C](int k) { return C[k]; });
    }
  }
  // No frame can move, and the landmarks' own factors are all that blurs the cost.
  const bool landmarks_only = rounding.Get() == 0.0;
  for (int l = 0; landmarks_only && l < static_cast<int>(schur.landmarks().size()); ++l) {
    const IncrementalSchur::Landmark& landmark = schur.landmarks()[l];
    if (landmark.id >= 0 && schur.IsInS(l)) {
      const double* P = schur.blocks().P(l);
      add(landmark.id, landmark.size, [P](int k) { return P[k * kQuad + k]; });
    }
  }
  return rounding.Get();
}

}  // namespace inceres::internal
