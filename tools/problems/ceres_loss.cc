#include "tools/problems/ceres_loss.h"

namespace inceres::tools {

std::unique_ptr<ceres::LossFunction> MakeCeresLoss(const LossSpec& spec) {
  switch (spec.kind) {
    case LossSpec::Kind::kHuber:
      return std::make_unique<ceres::HuberLoss>(spec.scale);
    case LossSpec::Kind::kCauchy:
      return std::make_unique<ceres::CauchyLoss>(spec.scale);
    case LossSpec::Kind::kNone:
      break;
  }
  return nullptr;
}

}  // namespace inceres::tools
