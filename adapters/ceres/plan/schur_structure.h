#pragma once

#include <string>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/introspection.h"

namespace inceres::internal {

/// The two strings of ceres::Solver::Summary that name the block sizes of a Schur problem: "residual,landmark,frame" in tangent
/// sizes, "d" where they vary, over the residual blocks that touch a landmark; zeros if none does.
struct SchurStructure {
  std::string given;  ///< as found in the problem
  std::string used;   ///< the closest of the specializations Ceres would pick (which ours need not be)
};

SchurStructure FindSchurStructure(const ProblemView& view, const LandmarkSelection& landmarks);

}  // namespace inceres::internal
