#include "incremental/running_cost.h"

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

}  // namespace inceres::internal
