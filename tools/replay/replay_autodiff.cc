#include "tools/replay/replay_autodiff.h"

#include <cstddef>

#include "tools/problems/bal_cost.h"
#include "tools/problems/keyframe_cost.h"
#include "tools/problems/pose_graph_cost.h"
#include "tools/problems/stereo_cost.h"

namespace inceres::tools {
namespace {

ceres::CostFunction* MakePrior(const DiagonalPriorFamily::Measurement& prior, int ambient_size) {
  const double* mean = prior.mean.data();
  const double* sqrt_information = prior.sqrt_information.data();
  switch (10 * prior.mean.size() + static_cast<std::size_t>(ambient_size)) {
    case 11:
      return DiagonalPriorError<1, 1>::Create(mean, sqrt_information);
    case 33:
      return DiagonalPriorError<3, 3>::Create(mean, sqrt_information);
    case 69:
      return DiagonalPriorError<6, 9>::Create(mean, sqrt_information);
    default:
      return nullptr;
  }
}

}  // namespace

std::unique_ptr<ceres::CostFunction> MakeAutoDiffCost(const ReplayFactor& factor,
                                                      ReplayVariable::Kind first) {
  ceres::CostFunction* cost = nullptr;
  if (const auto* bal = std::get_if<BalReprojectionFamily::Measurement>(&factor.measurement)) {
    cost = BalReprojectionError::Create({0, 0, bal->x, bal->y});
  } else if (const auto* reprojection =
                 std::get_if<InverseDepthReprojectionFamily::Measurement>(&factor.measurement)) {
    cost = InverseDepthReprojectionError::Create(*reprojection);
  } else if (const auto* relative =
                 std::get_if<RelativePoseFamily::Measurement>(&factor.measurement)) {
    cost = RelativePoseError::Create(*relative);
  } else if (const auto* prior =
                 std::get_if<DiagonalPriorFamily::Measurement>(&factor.measurement)) {
    cost = MakePrior(*prior, AmbientSize(first));
  } else if (const auto* stereo = std::get_if<StereoPointSighting>(&factor.measurement)) {
    cost = StereoReprojectionError::Create(stereo->seen, *stereo->camera);
  } else if (const auto* planar =
                 std::get_if<PlanarRelativePoseFamily::Measurement>(&factor.measurement)) {
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> U(
        planar->sqrt_information);
    cost = Se2BetweenError::Create(Eigen::Map<const Eigen::Vector3d>(planar->motion), U);
  }
  return std::unique_ptr<ceres::CostFunction>(cost);
}

}  // namespace inceres::tools
