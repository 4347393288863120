#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

#include "inceres/io/keyframe_graph.h"
#include "tools/replay/replay_scripts.h"

namespace inceres::tools {
namespace {

constexpr int kLoopGap = 10;  // keyframes further apart than this close a loop

class KeyframeScript {
 public:
  explicit KeyframeScript(const KeyframeSequence& sequence)
      : sequence_(sequence),
        guess_(sequence.features.size(), 0.0),
        variable_(sequence.features.size(), -1) {}

  std::vector<ReplayStep> Make() {
    std::vector<ReplayStep> steps(sequence_.keyframes.size() - 1);
    for (std::size_t i = 0; i < sequence_.keyframes.size(); ++i) {
      AddKeyframe(sequence_.keyframes[i], &steps[i == 0 ? 0 : i - 1]);
    }
    return steps;
  }

 private:
  void AddKeyframe(const Keyframe& keyframe, ReplayStep* step) {
    ReplayVariable pose;
    pose.kind = ReplayVariable::Kind::kPose;
    std::copy(keyframe.pose.begin(), keyframe.pose.end(), pose.start.begin());
    pose.constant = pose_variable_.empty();
    pose_variable_.push_back(num_variables_++);
    step->variables.push_back(pose);
    for (const KeyframeDepthGuess& guess : keyframe.depth_guesses) {
      guess_[static_cast<std::size_t>(guess.feature)] = guess.inverse_depth;
    }
    for (const KeyframeObservation& observation : keyframe.observations) {
      if (variable_[static_cast<std::size_t>(observation.feature)] < 0) {
        AddFeature(static_cast<std::size_t>(observation.feature), step);
      }
      AddObservation(observation, step);
    }
    for (const KeyframeBetween& between : keyframe.betweens) {
      AddBetween(between, step);
    }
  }

  void AddFeature(std::size_t feature, ReplayStep* step) {
    static const KeyframeGraphOptions kUsual;
    const double measured = sequence_.features[feature].inverse_depth;
    ReplayVariable inverse_depth;
    inverse_depth.kind = ReplayVariable::Kind::kInverseDepth;
    inverse_depth.start[0] = guess_[feature] > 0.0 ? guess_[feature]
                             : measured > 0.0      ? measured
                                                   : kUsual.unknown_inverse_depth;
    variable_[feature] = num_variables_++;
    step->variables.push_back(inverse_depth);
    if (measured > 0.0) {
      step->factors.push_back(
          {DiagonalPriorFamily::Measurement{{measured}, {1.0 / kUsual.depth_sigma}},
           {variable_[feature]},
           {}});
    }
  }

  void AddObservation(const KeyframeObservation& observation, ReplayStep* step) {
    const KeyframeFeature& feature =
        sequence_.features[static_cast<std::size_t>(observation.feature)];
    InverseDepthReprojectionFamily::Measurement measurement;
    // the reader let only positive definite ones through
    static_cast<void>(ToMeasurement(feature, observation, &measurement));
    step->factors.push_back(
        {measurement,
         {pose_variable_[static_cast<std::size_t>(feature.anchor)], pose_variable_.back(),
          variable_[static_cast<std::size_t>(observation.feature)]},
         kUnitHuber});
  }

  void AddBetween(const KeyframeBetween& between, ReplayStep* step) {
    RelativePoseFamily::Measurement measurement;
    static_cast<void>(ToMeasurement(between, &measurement));
    step->factors.push_back({measurement,
                             {pose_variable_[static_cast<std::size_t>(between.a)],
                              pose_variable_[static_cast<std::size_t>(between.b)]},
                             kUnitHuber});
    step->closes_loop = step->closes_loop || std::abs(between.a - between.b) > kLoopGap;
  }

  const KeyframeSequence& sequence_;
  std::vector<double> guess_;       // of each feature's inverse depth; 0: none yet
  std::vector<int> variable_;       // of each feature; -1: not in the problem yet
  std::vector<int> pose_variable_;  // of each keyframe so far
  int num_variables_ = 0;
};

}  // namespace

ReplayScript MakeKeyframeReplay(const KeyframeSequence& sequence) {
  ReplayScript script;
  script.description = std::to_string(sequence.keyframes.size()) + " keyframes, " +
                       std::to_string(sequence.NumObservations()) + " observations, " +
                       std::to_string(sequence.NumBetweens()) + " relative poses";
  script.dogleg = true;
  script.steps = KeyframeScript(sequence).Make();
  return script;
}

}  // namespace inceres::tools
