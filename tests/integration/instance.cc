#include "integration/instance.h"

#include <set>

namespace inceres::test {

std::shared_ptr<ceres::ParameterBlockOrdering> Instance::LandmarksFirst() const {
  if (landmarks.empty()) {
    return nullptr;
  }
  const std::set<double*> first(landmarks.begin(), landmarks.end());
  std::vector<double*> blocks;
  problem->GetParameterBlocks(&blocks);
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (double* block : blocks) {
    if (!problem->IsParameterBlockConstant(block)) {
      ordering->AddElementToGroup(block, first.count(block) > 0 ? 0 : 1);
    }
  }
  return ordering;
}

}  // namespace inceres::test
