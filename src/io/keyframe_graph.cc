#include "inceres/io/keyframe_graph.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>

#include "inceres/factors/pose_prior.h"
#include "inceres/problem/manifolds.h"
#include "problem/find_fault.h"

// A keyframe sequence as a factor graph: poses are frames, inverse depths of features are landmarks
// of one value, and an observation ties a landmark to the pose of its anchor and to that of the
// keyframe that sees it (InverseDepthReprojectionFamily).
//
// It happens in two steps, since a matrix that is not positive definite is found only when it is
// factored: MeasureAll makes the measurements of observations and relative poses, and may fail;
// AddTo then adds variables, priors of depths and connections, and cannot. Both walk through the
// keyframes in the same order, for the n-th factor of a family takes its n-th measurement.

namespace inceres {
namespace {

template <typename Entries>
bool IsAmong(int index, const Entries& entries) {
  return index >= 0 && static_cast<std::size_t>(index) < entries.size();
}

class KeyframeAdder {
 public:
  KeyframeAdder(const KeyframeSequence& sequence, const KeyframeGraphOptions& options)
      : sequence_(sequence), options_(options) {}

  /// Fills the families, which can fail, before the graph is touched.
  Status MeasureAll();
  void AddTo(FactorGraph* graph);
  KeyframeGraph* ids() { return &ids_; }

 private:
  Status CheckNumbers() const;
  Status CheckNumbers(std::size_t keyframe) const;
  void FindStarts();

  const KeyframeSequence& sequence_;
  const KeyframeGraphOptions& options_;
  // Its families are filled by MeasureAll, and get their ids in AddTo.
  KeyframeGraph ids_;
  std::vector<double> starts_;  // by feature
};

// A sequence that was made by hand may name what is not there.
Status KeyframeAdder::CheckNumbers() const {
  for (std::size_t k = 0; k < sequence_.features.size(); ++k) {
    if (!IsAmong(sequence_.features[k].anchor, sequence_.keyframes)) {
      return internal::Invalid("features[" + std::to_string(k) + "]: its anchor is no keyframe");
    }
  }
  Status status;
  for (std::size_t i = 0; i < sequence_.keyframes.size() && status.ok(); ++i) {
    status = CheckNumbers(i);
  }
  return status;
}

Status KeyframeAdder::CheckNumbers(std::size_t keyframe) const {
  const Keyframe& arriving = sequence_.keyframes[keyframe];
  const auto is_feature = [this](const auto& entry) {
    return IsAmong(entry.feature, sequence_.features);
  };
  const auto are_keyframes = [this](const KeyframeBetween& between) {
    return IsAmong(between.a, sequence_.keyframes) && IsAmong(between.b, sequence_.keyframes);
  };
  const auto all = [](const auto& entries, const auto& fits) {
    return std::all_of(entries.begin(), entries.end(), fits);
  };
  const std::string name = "keyframe " + std::to_string(keyframe);
  if (!all(arriving.observations, is_feature) || !all(arriving.depth_guesses, is_feature)) {
    return internal::Invalid(name + " sees, or guesses the depth of, a feature that is not there");
  }
  return all(arriving.betweens, are_keyframes)
             ? Status::Ok()
             : internal::Invalid(name + " has a relative pose of a keyframe that is not there");
}

Status KeyframeAdder::MeasureAll() {
  // Any finite inverse depth is a start, 0 too: the residual is smooth at a point at infinity.
  if (!(options_.depth_sigma > 0.0) || !std::isfinite(options_.unknown_inverse_depth)) {
    return internal::Invalid(
        "KeyframeGraphOptions::depth_sigma must be > 0, unknown_inverse_depth finite");
  }
  if (Status status = CheckNumbers(); !status.ok()) {
    return status;
  }
  ids_.reprojections.family = std::make_shared<InverseDepthReprojectionFamily>();
  // Depths are measured in AddTo, which knows which features are seen again.
  ids_.depths.family = std::make_shared<DiagonalPriorFamily>(1);
  ids_.betweens.family = std::make_shared<RelativePoseFamily>();
  for (std::size_t i = 0; i < sequence_.keyframes.size(); ++i) {
    for (const KeyframeObservation& observation : sequence_.keyframes[i].observations) {
      InverseDepthReprojectionFamily::Measurement seen;
      if (!ToMeasurement(sequence_.features[static_cast<std::size_t>(observation.feature)],
                         observation, &seen)) {
        return internal::Invalid("keyframe " + std::to_string(i) + ", observation of feature " +
                                 std::to_string(observation.feature) +
                                 ": the information matrix is not positive definite");
      }
      ids_.reprojections->Add(seen);
    }
    for (const KeyframeBetween& between : sequence_.keyframes[i].betweens) {
      RelativePoseFamily::Measurement measured;
      if (!ToMeasurement(between, &measured)) {
        return internal::Invalid("relative pose of keyframes " + std::to_string(between.a) +
                                 " and " + std::to_string(between.b) +
                                 ": the information matrix is not positive definite");
      }
      ids_.betweens->Add(measured);
    }
  }
  return Status::Ok();
}

// Where each feature starts. By feature: the last guess, else the measurement of the anchor, else
// the option's. A guess of a late keyframe counts from the start: the whole sequence is one problem
// here.
void KeyframeAdder::FindStarts() {
  for (const KeyframeFeature& feature : sequence_.features) {
    starts_.push_back(feature.inverse_depth > 0.0 ? feature.inverse_depth
                                                  : options_.unknown_inverse_depth);
  }
  for (const Keyframe& keyframe : sequence_.keyframes) {
    for (const KeyframeDepthGuess& guess : keyframe.depth_guesses) {
      starts_[static_cast<std::size_t>(guess.feature)] = guess.inverse_depth;
    }
  }
}

void KeyframeAdder::AddTo(FactorGraph* graph) {
  FindStarts();
  const std::shared_ptr<const Loss>& loss = options_.read.loss;
  ids_.reprojections.id = graph->AddFamily(ids_.reprojections.family).id;
  ids_.depths.id = graph->AddFamily(ids_.depths.family).id;
  ids_.betweens.id = graph->AddFamily(ids_.betweens.family).id;
  const auto manifold = std::make_shared<PoseManifold>();
  for (const Keyframe& keyframe : sequence_.keyframes) {
    ids_.poses.push_back(graph->AddVariable(keyframe.pose.data(), 7, Role::kFrame, manifold));
  }
  // −1 until a keyframe sees the feature again. One that only its anchor sees has no factor but a
  // depth prior, and would be a variable that nothing ties to the others.
  ids_.features.assign(sequence_.features.size(), -1);
  for (std::size_t i = 0; i < sequence_.keyframes.size(); ++i) {
    for (const KeyframeObservation& observation : sequence_.keyframes[i].observations) {
      const auto number = static_cast<std::size_t>(observation.feature);
      const KeyframeFeature& feature = sequence_.features[number];
      VariableId& id = ids_.features[number];
      // Its first observation adds the landmark, so landmarks stand in the order in which they are
      // seen again.
      if (id < 0) {
        const double start = starts_[number];
        id = graph->AddVariable(&start, 1, Role::kLandmark);
        // Without the loss: the prior is a depth that the anchor measured, and no match that may be
        // wrong.
        if (feature.inverse_depth > 0.0) {
          graph->AddFactor(ids_.depths, {{feature.inverse_depth}, {1.0 / options_.depth_sigma}},
                           {id});
        }
      }
      // The anchor first, as the family has it; it is not the observing keyframe, which the reader
      // checks.
      const VariableId slots[] = {ids_.poses[static_cast<std::size_t>(feature.anchor)],
                                  ids_.poses[i], id};
      graph->Connect(ids_.reprojections, slots, loss);
    }
    for (const KeyframeBetween& between : sequence_.keyframes[i].betweens) {
      const VariableId slots[] = {ids_.poses[static_cast<std::size_t>(between.a)],
                                  ids_.poses[static_cast<std::size_t>(between.b)]};
      graph->Connect(ids_.betweens, slots, loss);
    }
  }
}

}  // namespace

// The anchor's image point counts as exact: the ray through it is what the inverse depth is along.
bool ToMeasurement(const KeyframeFeature& feature, const KeyframeObservation& observation,
                   InverseDepthReprojectionFamily::Measurement* measurement) {
  const std::array<double, 3>& w = observation.information;
  const double information[4] = {w[0], w[1], w[1], w[2]};
  double U[4];
  if (!SqrtInformation(information, 2, U)) {
    return false;
  }
  // U[2], below the diagonal, is zero.
  *measurement = {{feature.x, feature.y}, {observation.x, observation.y}, {U[0], U[1], U[3]}};
  return true;
}

// Order and axes of the file are those of the family: rotation before position.
bool ToMeasurement(const KeyframeBetween& between, RelativePoseFamily::Measurement* measurement) {
  std::copy(between.q_ab.begin(), between.q_ab.end(), measurement->q_ab);
  std::copy(between.p_ab.begin(), between.p_ab.end(), measurement->p_ab);
  return SqrtInformation(between.information.data(), 6, measurement->sqrt_information);
}

Status AddKeyframes(const KeyframeSequence& sequence, const KeyframeGraphOptions& options,
                    FactorGraph* graph, KeyframeGraph* ids) {
  KeyframeAdder adder(sequence, options);
  Status status = adder.MeasureAll();
  if (status.ok()) {
    adder.AddTo(graph);
    if (ids != nullptr) {
      *ids = std::move(*adder.ids());
    }
  }
  return status;
}

Status ReadKeyframes(const std::string& path, FactorGraph* graph, KeyframeGraph* ids,
                     const KeyframeGraphOptions& options) {
  KeyframeSequence sequence;
  const Status status = ReadKeyframes(path, &sequence, options.read.file);
  return status.ok() ? AddKeyframes(sequence, options, graph, ids) : status;
}

}  // namespace inceres
