#pragma once

#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/io/keyframes.h"
#include "inceres/io/read_options.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/status.h"

namespace inceres {

/// How a keyframe sequence becomes a graph.
struct KeyframeGraphOptions {
  GraphReadOptions read;               ///< its loss: of observations and relative poses
  double depth_sigma = 0.1;            ///< > 0, 1/m: of inverse depths that an anchor has measured
  double unknown_inverse_depth = 0.5;  ///< 1/m: where a feature without guess or measurement starts
};

/// Which variables of a graph a keyframe sequence has become.
struct KeyframeGraph {
  std::vector<VariableId> poses;     ///< by keyframe: frames on PoseManifold
  std::vector<VariableId> features;  ///< inverse depths, landmarks; −1: no keyframe sees it again
  FamilyHandle<InverseDepthReprojectionFamily> reprojections;  ///< of the observations
  FamilyHandle<DiagonalPriorFamily> depths;                    ///< measured inverse depths
  FamilyHandle<RelativePoseFamily> betweens;                   ///< of the relative poses
};

/// An observation of a feature, and a relative pose, as factors. False if the information is not
/// positive definite; ReadKeyframes lets no other through.
[[nodiscard]] INCERES_EXPORT bool ToMeasurement(
    const KeyframeFeature& feature, const KeyframeObservation& observation,
    InverseDepthReprojectionFamily::Measurement* measurement);
/// The same of a relative pose.
[[nodiscard]] INCERES_EXPORT bool ToMeasurement(const KeyframeBetween& between,
                                                RelativePoseFamily::Measurement* measurement);

/// Adds all keyframes as frames, the features that are seen again as landmarks, starting at their
/// last guess, else their measured inverse depth, else the option's, and a factor for each
/// observation, measured inverse depth (of features seen again) and relative pose. Nothing is
/// held: HoldGauge (factors/gauge.h) holds the first pose.
///
/// kInvalidArgument, graph and ids unchanged, for options or information matrices that are not
/// positive (definite), and for numbers of features and keyframes that are not there; the message
/// names the culprit. `ids` may be null. Cost: one pass. Threads:
/// one writer.
INCERES_EXPORT Status AddKeyframes(const KeyframeSequence& sequence,
                                   const KeyframeGraphOptions& options, FactorGraph* graph,
                                   KeyframeGraph* ids);

/// Reads a file of keyframes into a graph: ReadKeyframes, then AddKeyframes. On an error of either,
/// graph and ids are unchanged.
INCERES_EXPORT Status ReadKeyframes(const std::string& path, FactorGraph* graph,
                                    KeyframeGraph* ids = nullptr,
                                    const KeyframeGraphOptions& options = KeyframeGraphOptions());

}  // namespace inceres
