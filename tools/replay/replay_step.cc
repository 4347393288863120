#include "tools/replay/replay_step.h"

#include <algorithm>
#include <cassert>
#include <cstddef>

#include "inceres/problem/rotation.h"

namespace inceres::tools {

int AmbientSize(ReplayVariable::Kind kind) {
  switch (kind) {
    case ReplayVariable::Kind::kBalCamera:
    case ReplayVariable::Kind::kBalCameraPose:
    case ReplayVariable::Kind::kSpeedBias:
      return 9;
    case ReplayVariable::Kind::kPoint:
    case ReplayVariable::Kind::kPlanarPose:
      return 3;
    case ReplayVariable::Kind::kPose:
      return 7;
    case ReplayVariable::Kind::kInverseDepth:
      return 1;
  }
  return 0;
}

int TangentSize(ReplayVariable::Kind kind) {
  const bool six =
      kind == ReplayVariable::Kind::kBalCameraPose || kind == ReplayVariable::Kind::kPose;
  return six ? 6 : AmbientSize(kind);
}

bool IsLandmark(ReplayVariable::Kind kind) {
  return kind == ReplayVariable::Kind::kPoint || kind == ReplayVariable::Kind::kInverseDepth;
}

std::vector<std::array<double, 9>> StartValues(const ReplayStep& step, int first,
                                               const std::function<const double*(int)>& value) {
  std::vector<std::array<double, 9>> starts;
  for (const ReplayVariable& variable : step.variables) {
    std::array<double, 9> start = variable.start;
    if (variable.start_from >= 0) {
      assert(variable.start_from < first + static_cast<int>(starts.size()));
      const double* pose =
          variable.start_from < first
              ? value(variable.start_from)
              : starts[static_cast<std::size_t>(variable.start_from - first)].data();
      assert(variable.kind == ReplayVariable::Kind::kPlanarPose ||
             variable.kind == ReplayVariable::Kind::kPoint ||
             variable.kind == ReplayVariable::Kind::kPose);
      (variable.kind == ReplayVariable::Kind::kPlanarPose ? ComposePlanarPoses
       : variable.kind == ReplayVariable::Kind::kPoint
           ? TransformPoint
           : ComposePoses)(pose, variable.start.data(), start.data());
    }
    starts.push_back(start);
  }
  return starts;
}

std::size_t NumSteps(const ReplayScript& script, int max_steps) {
  return max_steps > 0 ? std::min(script.steps.size(), static_cast<std::size_t>(max_steps))
                       : script.steps.size();
}

bool HasLandmarks(const ReplayScript& script) {
  return std::any_of(script.steps.begin(), script.steps.end(), [](const ReplayStep& step) {
    return std::any_of(step.variables.begin(), step.variables.end(),
                       [](const ReplayVariable& variable) { return IsLandmark(variable.kind); });
  });
}

}  // namespace inceres::tools
