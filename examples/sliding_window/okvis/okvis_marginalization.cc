// What leaves the map of OkvisEstimator, and what stays of it.

#include "okvis/okvis_estimator.h"

namespace sliding_window {
namespace {

// of the oldest pose's position and yaw, once the first has left
constexpr double kPosePriorInformation = 1e14;

}  // namespace

void OkvisEstimator::Marginalize() {
  if (marginalization_id_ != nullptr) {
    problem_.RemoveResidualBlock(marginalization_id_);
    marginalization_id_ = nullptr;
  }
  const int leaving = next_frame_ - 1 - okvis_options_.num_imu_frames;
  if (leaving >= 0) {
    LeaveImuWindow(leaving);
  }
  int num_keyframes = 0;
  int oldest_keyframe = -1;
  for (auto frame = frames_.rbegin(); frame != frames_.rend(); ++frame) {
    if (frame->second.is_keyframe && !frame->second.has_speed_bias) {
      ++num_keyframes;
      oldest_keyframe = frame->first;
    }
  }
  if (num_keyframes > okvis_options_.num_keyframes) {
    RemovePose(oldest_keyframe, /*marginalize_landmarks=*/true);
  }
  PutBackMarginalizationError();
}

// Its speed and biases go, and its pose if it is no keyframe.
void OkvisEstimator::LeaveImuWindow(int id) {
  FrameBlocks& frame = frames_.at(id);
  LinearizeAndRemove(&frame.speed_bias_prior);
  LinearizeAndRemove(&frames_.at(id + 1).imu);
  marginalization_error_.MarginalizeOut({frame.speed_bias});
  problem_.RemoveParameterBlock(frame.speed_bias);
  frame.has_speed_bias = false;
  if (!frame.is_keyframe) {
    RemovePose(id, /*marginalize_landmarks=*/false);
  }
}

// What the frame alone knew of landmarks is dropped; landmarks that the newest frame does not see
// any more are marginalized with it.
void OkvisEstimator::RemovePose(int id, bool marginalize_landmarks) {
  FrameBlocks& frame = frames_.at(id);
  const bool is_oldest = id == frames_.begin()->first;
  for (auto next = landmarks_.begin(); next != landmarks_.end();) {
    const auto current = next++;
    Landmark& landmark = current->second;
    if (!landmark.IsSeenIn(id)) {
      continue;
    }
    const bool in_view = landmark.IsSeenIn(next_frame_ - 1);
    if (marginalize_landmarks && !in_view && landmark.is_variable &&
        landmark.sightings.size() >= 2) {
      MarginalizeLandmark(&landmark);
    } else {
      for (auto sighting = landmark.sightings.lower_bound({id, 0}); landmark.IsSeenIn(id);) {
        RemoveResidual(&sighting->second.residual);
        sighting = landmark.sightings.erase(sighting);
      }
    }
    if (landmark.sightings.empty() || (!in_view && landmark.sightings.size() < 2)) {
      RemoveLandmark(current);
    }
  }
  if (is_oldest) {
    RemoveResidual(&pose_prior_);
  }
  marginalization_error_.MarginalizeOut({frame.pose});
  problem_.RemoveParameterBlock(frame.pose);
  frames_.erase(id);
  if (is_oldest) {
    SetPosePrior(frames_.begin()->first, kPosePriorInformation);
  }
}

void OkvisEstimator::MarginalizeLandmark(Landmark* landmark) {
  for (auto& [id, sighting] : landmark->sightings) {
    LinearizeAndRemove(&sighting.residual);
  }
  landmark->sightings.clear();
  marginalization_error_.MarginalizeOut({landmark->x});
}

void OkvisEstimator::RemoveLandmark(LandmarkIterator landmark) {
  for (auto& [id, sighting] : landmark->second.sightings) {
    RemoveResidual(&sighting.residual);
  }
  if (landmark->second.is_variable) {
    problem_.RemoveParameterBlock(landmark->second.x);
  }
  landmarks_.erase(landmark);
}

void OkvisEstimator::PutBackMarginalizationError() {
  const std::vector<double*> blocks = marginalization_error_.Blocks();
  if (!blocks.empty()) {
    marginalization_error_.Update();
    marginalization_id_ = problem_.AddResidualBlock(&marginalization_error_, nullptr, blocks);
  }
}

void OkvisEstimator::LinearizeAndRemove(Residual* residual) {
  if (residual->id != nullptr) {
    marginalization_error_.Add(problem_, residual->id);
    RemoveResidual(residual);
  }
}

}  // namespace sliding_window
