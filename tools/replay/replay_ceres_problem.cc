#include "tools/replay/replay_ceres_problem.h"

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>

#include <ceres/manifold.h>
#include <ceres/product_manifold.h>

#include "inceres/factors/imu_factor.h"
#include "tools/problems/ceres_loss.h"
#include "tools/problems/factor_cost_function.h"
#include "tools/replay/replay_autodiff.h"

namespace inceres::tools {
ceres::Manifold* ReplayCeresProblem::ManifoldOf(ReplayVariable::Kind kind) {
  using PlainPoseManifold =
      ceres::ProductManifold<ceres::EuclideanManifold<3>, ceres::EigenQuaternionManifold>;
  const auto found = manifolds_.find(kind);
  if (found != manifolds_.end()) {
    return found->second;
  }
  ceres::Manifold* manifold = nullptr;
  if (kind == ReplayVariable::Kind::kBalCameraPose) {
    manifold = new ceres::SubsetManifold(9, {6, 7, 8});
  } else if (kind == ReplayVariable::Kind::kPose) {
    manifold =
        autodiff_ ? static_cast<ceres::Manifold*>(new PlainPoseManifold) : new PoseBlockManifold;
  }
  return manifolds_[kind] = manifold;
}

ceres::LossFunction* ReplayCeresProblem::LossOf(const LossSpec& spec) {
  if (spec.kind == LossSpec::Kind::kNone) {
    return nullptr;
  }
  ceres::LossFunction*& loss = losses_[spec];
  if (loss == nullptr) {
    loss = MakeCeresLoss(spec).release();
  }
  return loss;
}

ceres::CostFunction* ReplayCeresProblem::CostOf(const ReplayFactor& factor) const {
  if (autodiff_) {
    return MakeAutoDiffCost(factor, kinds_[static_cast<std::size_t>(factor.variables[0])])
        .release();
  }
  if (const auto* bal = std::get_if<BalReprojectionFamily::Measurement>(&factor.measurement)) {
    return MakeFactorCost<BalReprojectionFamily>(*bal);
  }
  if (const auto* reprojection =
          std::get_if<InverseDepthReprojectionFamily::Measurement>(&factor.measurement)) {
    return MakeFactorCost<InverseDepthReprojectionFamily>(*reprojection);
  }
  if (const auto* relative = std::get_if<RelativePoseFamily::Measurement>(&factor.measurement)) {
    return MakeFactorCost<RelativePoseFamily>(*relative);
  }
  if (const auto* sighting = std::get_if<PointSighting>(&factor.measurement)) {
    return MakeFactorCost<PointReprojectionFamily>(sighting->seen, *sighting->camera);
  }
  if (const auto* imu = std::get_if<std::shared_ptr<const ImuPreintegrator>>(&factor.measurement)) {
    return MakeFactorCost<ImuFactorFamily>(**imu);
  }
  if (const auto* stereo = std::get_if<StereoPointSighting>(&factor.measurement)) {
    return MakeFactorCost<StereoReprojectionFamily>(stereo->seen, *stereo->camera);
  }
  if (const auto* planar =
          std::get_if<PlanarRelativePoseFamily::Measurement>(&factor.measurement)) {
    return MakeFactorCost<PlanarRelativePoseFamily>(*planar);
  }
  const auto& prior = std::get<DiagonalPriorFamily::Measurement>(factor.measurement);
  const int ambient_size = AmbientSize(kinds_[static_cast<std::size_t>(factor.variables[0])]);
  return MakeFactorCost<DiagonalPriorFamily>(prior, static_cast<int>(prior.mean.size()),
                                             ambient_size, ambient_size);
}

double* ReplayCeresProblem::Place(ReplayVariable::Kind kind, const double* start) {
  double* values = storage_;
  if (storage_ == nullptr) {
    values = owned_.emplace_back().data();
  } else {
    storage_ += AmbientSize(kind);
  }
  std::copy_n(start, AmbientSize(kind), values);
  values_.push_back(values);
  return values;
}

Status ReplayCeresProblem::Add(const ReplayStep& step) {
  const std::vector<std::array<double, 9>> starts =
      StartValues(step, static_cast<int>(values_.size()),
                  [this](int number) { return values_[static_cast<std::size_t>(number)]; });
  for (std::size_t i = 0; i < step.variables.size(); ++i) {
    const ReplayVariable& variable = step.variables[i];
    double* values = Place(variable.kind, starts[i].data());
    kinds_.push_back(variable.kind);
    problem_->AddParameterBlock(values, AmbientSize(variable.kind), ManifoldOf(variable.kind));
    if (variable.constant) {
      problem_->SetParameterBlockConstant(values);
    }
    ordering_.AddElementToGroup(values, IsLandmark(variable.kind) ? 0 : 1);
  }
  for (std::size_t i = 0; i < step.factors.size(); ++i) {
    const ReplayFactor& factor = step.factors[i];
    ceres::CostFunction* cost = CostOf(factor);
    if (cost == nullptr) {
      return Status::Error(
          StatusCode::kInvalidArgument,
          "factor " + std::to_string(i) + " of the step: it has no AutoDiff version");
    }
    std::vector<double*> blocks;
    for (const int variable : factor.variables) {
      blocks.push_back(values_[static_cast<std::size_t>(variable)]);
    }
    problem_->AddResidualBlock(cost, LossOf(factor.loss), blocks);
  }
  return Status::Ok();
}

std::shared_ptr<ceres::ParameterBlockOrdering> ReplayCeresProblem::LandmarksFirst() const {
  return std::make_shared<ceres::ParameterBlockOrdering>(ordering_);
}

std::vector<double> ReplayCeresProblem::State() const {
  std::vector<double> state;
  for (std::size_t i = 0; i < kinds_.size(); ++i) {
    state.insert(state.end(), values_[i], values_[i] + AmbientSize(kinds_[i]));
  }
  return state;
}

void ReplayCeresProblem::SetState(const std::vector<double>& state) {
  auto next = state.begin();
  for (std::size_t i = 0; i < kinds_.size(); ++i) {
    std::copy_n(next, AmbientSize(kinds_[i]), values_[i]);
    next += AmbientSize(kinds_[i]);
  }
}

}  // namespace inceres::tools
