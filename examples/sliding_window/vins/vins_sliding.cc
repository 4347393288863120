// How the window of VinsEstimator slides.

#include <algorithm>

#include "vins/imu_factor.h"
#include "vins/projection_factor.h"
#include "vins/vins_estimator.h"

namespace sliding_window {
namespace {

// The places in `blocks` of what leaves.
std::vector<int> PlacesOf(const std::vector<double*>& blocks,
                          const std::vector<const double*>& leaving) {
  std::vector<int> places;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    if (std::find(leaving.begin(), leaving.end(), blocks[i]) != leaving.end()) {
      places.push_back(static_cast<int>(i));
    }
  }
  return places;
}

}  // namespace

// Frame 0 becomes part of the prior, with the features it saw first.
void VinsEstimator::MarginalizeOldest(const ceres::LossFunction& loss) {
  StatesToParameters();
  auto info = std::make_unique<MarginalizationInfo>();
  if (prior_ != nullptr) {
    info->Add(MarginalizationFactor(prior_.get()), nullptr, prior_blocks_,
              PlacesOf(prior_blocks_, {para_pose_[0], para_speed_bias_[0]}));
  }
  info->Add(ImuFactor(imu_[1]), nullptr,
            {para_pose_[0], para_speed_bias_[0], para_pose_[1], para_speed_bias_[1]}, {0, 1});
  for (std::size_t i = 0; i < used_features_.size(); ++i) {
    const FeatureTrack& track = *used_features_[i];
    for (int k = 1; track.start == 0 && k <= track.last(); ++k) {
      info->Add(ProjectionFactor(track.xy.front(), track.xy[k], projection_weight()), &loss,
                {para_pose_[0], para_pose_[k], para_extrinsic_, &para_inverse_depth_[i]}, {0, 3});
    }
  }
  info->Marginalize();
  // In the next window frame k lies where k - 1 lay.
  std::unordered_map<const double*, double*> moved;
  for (int k = 1; k < kNumFrames; ++k) {
    moved[para_pose_[k]] = para_pose_[k - 1];
    moved[para_speed_bias_[k]] = para_speed_bias_[k - 1];
  }
  prior_blocks_ = info->KeptBlocks(moved);
  // the running problem's prior factor is left without its prior: it is not evaluated any more
  prior_ = std::move(info);
}

// The frame before the newest leaves the prior; what the frame saw is forgotten.
void VinsEstimator::MarginalizeSecondNewest() {
  const std::vector<int> places = PlacesOf(prior_blocks_, {para_pose_[kNewest - 1]});
  if (places.empty()) {
    return;
  }
  StatesToParameters();
  auto info = std::make_unique<MarginalizationInfo>();
  info->Add(MarginalizationFactor(prior_.get()), nullptr, prior_blocks_, places);
  info->Marginalize();
  prior_blocks_ = info->KeptBlocks({});  // nothing that stays moves
  prior_ = std::move(info);
}

void VinsEstimator::SlideOldest() {
  features_.RemoveBehindCamera();
  features_.RemoveOldest(CameraPose(0), CameraPose(1));
  std::rotate(states_.begin(), states_.begin() + 1, states_.end());
  std::rotate(imu_.begin(), imu_.begin() + 1, imu_.end());
}

void VinsEstimator::SlideSecondNewest() {
  features_.RemoveBehindCamera();
  features_.RemoveSecondNewest();
  imu_[kNewest - 1]->Append(imu_[kNewest]->samples());
  states_[kNewest - 1] = states_[kNewest];
}

}  // namespace sliding_window
