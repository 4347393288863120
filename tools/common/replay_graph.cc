#include "tools/common/replay_graph.h"

#include <cstddef>

#include "inceres/graph/manifolds.h"

namespace inceres::tools {

std::shared_ptr<const Manifold> ReplayGraph::ManifoldOf(ReplayVariable::Kind kind) {
  std::shared_ptr<const Manifold>& manifold = manifolds_[kind];
  if (manifold == nullptr && kind == ReplayVariable::Kind::kBalCameraPose) {
    manifold = std::make_shared<SubsetManifold>(9, std::vector<int>{6, 7, 8});
  } else if (manifold == nullptr && kind == ReplayVariable::Kind::kPose) {
    manifold = std::make_shared<PoseManifold>();
  }
  return manifold;
}

std::shared_ptr<const Loss> ReplayGraph::LossOf(double huber) {
  if (huber == 0.0) {
    return nullptr;
  }
  std::shared_ptr<const Loss>& loss = losses_[huber];
  if (loss == nullptr) {
    loss = std::make_shared<HuberLoss>(huber);
  }
  return loss;
}

template <typename Family, typename... Arguments>
void ReplayGraph::AddTo(Member<Family>* member, const typename Family::Measurement& measurement, const ReplayFactor& factor,
                        Arguments... arguments) {
  if (member->family == nullptr) {
    member->family = std::make_shared<Family>(arguments...);
    member->id = graph_.AddFamily(member->family);
  }
  graph_.AddFactor(member->id, *member->family, measurement, factor.variables, LossOf(factor.huber));
}

void ReplayGraph::AddFactor(const ReplayFactor& factor) {
  const ReplayVariable::Kind first_kind = kinds_[static_cast<std::size_t>(factor.variables[0])];
  const int tangent_size = TangentSize(first_kind);
  if (const auto* bal = std::get_if<BalReprojectionFamily::Measurement>(&factor.measurement)) {
    AddTo(&bal_[tangent_size], *bal, factor, tangent_size);
  } else if (const auto* reprojection = std::get_if<InverseDepthReprojectionFamily::Measurement>(&factor.measurement)) {
    AddTo(&inverse_depth_, *reprojection, factor);
  } else if (const auto* relative = std::get_if<RelativePoseFamily::Measurement>(&factor.measurement)) {
    AddTo(&relative_pose_, *relative, factor);
  } else {
    const auto& prior = std::get<DiagonalPriorFamily::Measurement>(factor.measurement);
    const PriorShape shape{static_cast<int>(prior.mean.size()), AmbientSize(first_kind), tangent_size};
    AddTo(&priors_[shape], prior, factor, std::get<0>(shape), std::get<1>(shape), std::get<2>(shape));
  }
}

void ReplayGraph::Add(const ReplayStep& step) {
  for (const ReplayVariable& variable : step.variables) {
    const Role role = IsLandmark(variable.kind) ? Role::kLandmark : Role::kFrame;
    const VariableId id = graph_.AddVariable(variable.start.data(), AmbientSize(variable.kind), role, ManifoldOf(variable.kind));
    kinds_.push_back(variable.kind);
    graph_.SetConstant(id, variable.constant);
  }
  for (const ReplayFactor& factor : step.factors) {
    AddFactor(factor);
  }
}

}  // namespace inceres::tools
