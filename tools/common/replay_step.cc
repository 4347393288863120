#include "tools/common/replay_step.h"

namespace inceres::tools {

int AmbientSize(ReplayVariable::Kind kind) {
  switch (kind) {
    case ReplayVariable::Kind::kBalCamera:
    case ReplayVariable::Kind::kBalCameraPose:
    case ReplayVariable::Kind::kSpeedBias:
      return 9;
    case ReplayVariable::Kind::kPoint:
      return 3;
    case ReplayVariable::Kind::kPose:
      return 7;
    case ReplayVariable::Kind::kInverseDepth:
      return 1;
  }
  return 0;
}

int TangentSize(ReplayVariable::Kind kind) {
  const bool six = kind == ReplayVariable::Kind::kBalCameraPose || kind == ReplayVariable::Kind::kPose;
  return six ? 6 : AmbientSize(kind);
}

bool IsLandmark(ReplayVariable::Kind kind) {
  return kind == ReplayVariable::Kind::kPoint || kind == ReplayVariable::Kind::kInverseDepth;
}

}  // namespace inceres::tools
