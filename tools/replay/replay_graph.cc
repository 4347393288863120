#include "tools/replay/replay_graph.h"

#include <cstddef>
#include <string>
#include <utility>

#include "inceres/problem/manifolds.h"
#include "tools/replay/replay_autodiff.h"

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

std::shared_ptr<const Loss> ReplayGraph::LossOf(const LossSpec& spec) {
  std::shared_ptr<const Loss>& loss = losses_[spec];
  if (loss == nullptr) {
    loss = MakeCoreLoss(spec);  // null again for none
  }
  return loss;
}

template <typename Visit>
Status ReplayGraph::VisitFamily(const ReplayFactor& factor, const Visit& visit) {
  if (autodiff_) {
    return VisitAutoDiffFamily(factor, visit);
  }
  const ReplayVariable::Kind first_kind = kinds_[static_cast<std::size_t>(factor.variables[0])];
  const int tangent_size = TangentSize(first_kind);
  if (const auto* bal = std::get_if<BalReprojectionFamily::Measurement>(&factor.measurement)) {
    visit(&bal_[tangent_size], *bal, tangent_size);
  } else if (const auto* reprojection =
                 std::get_if<InverseDepthReprojectionFamily::Measurement>(&factor.measurement)) {
    visit(&inverse_depth_, *reprojection);
  } else if (const auto* relative =
                 std::get_if<RelativePoseFamily::Measurement>(&factor.measurement)) {
    visit(&relative_pose_, *relative);
  } else if (const auto* sighting = std::get_if<PointSighting>(&factor.measurement)) {
    visit(&points_[sighting->camera.get()], sighting->seen, *sighting->camera);
  } else if (const auto* imu =
                 std::get_if<std::shared_ptr<const ImuPreintegrator>>(&factor.measurement)) {
    visit(&imu_, **imu);
  } else if (const auto* stereo = std::get_if<StereoPointSighting>(&factor.measurement)) {
    visit(&stereo_[stereo->camera.get()], stereo->seen, *stereo->camera);
  } else if (const auto* planar =
                 std::get_if<PlanarRelativePoseFamily::Measurement>(&factor.measurement)) {
    visit(&planar_, *planar);
  } else {
    const auto& prior = std::get<DiagonalPriorFamily::Measurement>(factor.measurement);
    const int size = static_cast<int>(prior.mean.size());
    const int ambient_size = AmbientSize(first_kind);
    visit(&priors_[{size, ambient_size, tangent_size}], prior, size, ambient_size, tangent_size);
  }
  return Status::Ok();
}

template <typename Visit>
Status ReplayGraph::VisitAutoDiffFamily(const ReplayFactor& factor, const Visit& visit) {
  const std::shared_ptr<const ceres::CostFunction> cost =
      MakeAutoDiffCost(factor, kinds_[static_cast<std::size_t>(factor.variables[0])]);
  if (cost == nullptr) {
    return Status::Error(StatusCode::kInvalidArgument, "it has no AutoDiff version");
  }
  std::vector<int> shape{cost->num_residuals()};
  std::vector<FactorFamily::Slot> slots;
  for (const int variable : factor.variables) {
    const ReplayVariable::Kind kind = kinds_[static_cast<std::size_t>(variable)];
    slots.push_back({AmbientSize(kind), TangentSize(kind)});
    shape.insert(shape.end(), {slots.back().ambient_size, slots.back().tangent_size});
  }
  visit(&autodiff_families_[shape], cost, cost->num_residuals(), slots);
  return Status::Ok();
}

Status ReplayGraph::Prepare(const ReplayStep& step, const AddFamilyFunction& add_family) {
  for (const ReplayVariable& variable : step.variables) {
    kinds_.push_back(variable.kind);
  }
  const auto add = [&add_family](auto* handle, const auto& /*measurement*/, const auto&... sizes) {
    if (handle->family == nullptr) {
      using Family = typename std::remove_reference_t<decltype(handle->family)>::element_type;
      handle->family = std::make_shared<Family>(sizes...);
      handle->id = add_family(handle->family);
    }
  };
  for (std::size_t i = 0; i < step.factors.size(); ++i) {
    if (Status status = VisitFamily(step.factors[i], add); !status.ok()) {
      status.message = "factor " + std::to_string(i) + " of the step: " + status.message;
      return status;
    }
  }
  return Status::Ok();
}

template <typename Target>
Status ReplayGraph::AddStep(const ReplayStep& step, const ValueFunction& value, Target* target) {
  const int first = static_cast<int>(kinds_.size() - step.variables.size());
  const std::vector<std::array<double, 9>> starts = StartValues(step, first, value);
  for (std::size_t i = 0; i < step.variables.size(); ++i) {
    const ReplayVariable& variable = step.variables[i];
    const Role role = IsLandmark(variable.kind) ? Role::kLandmark : Role::kFrame;
    const VariableId id = target->AddVariable(starts[i].data(), AmbientSize(variable.kind), role,
                                              ManifoldOf(variable.kind));
    if (variable.constant) {
      target->SetConstant(id, true);
    }
  }
  for (const ReplayFactor& factor : step.factors) {
    const Status status = VisitFamily(factor, [&](auto* handle, const auto& measurement,
                                                  const auto&... /*sizes*/) {
      Note(target->AddFactor(*handle, measurement, factor.variables, LossOf(factor.loss)), factor);
    });
    if (!status.ok()) {
      return status;
    }
  }
  return Status::Ok();
}

Status ReplayGraph::Add(const ReplayStep& step, FactorGraph* graph) {
  const Status status =
      Prepare(step, [graph](auto family) { return graph->AddFamily(std::move(family)); });
  return status.ok() ? AddStep(
                           step, [graph](VariableId id) { return graph->Values(id); }, graph)
                     : status;
}

Status ReplayGraph::AddAsEdit(const ReplayStep& step, const FactorGraph& graph,
                              const ValueFunction& value, const AddFamilyFunction& add_family,
                              const ApplyFunction& apply) {
  new_suspects_.clear();
  Status status = Prepare(step, add_family);
  if (!status.ok()) {
    return status;
  }
  GraphEdit edit(graph);  // only now: adding a family is a change of the graph
  status = AddStep(step, value, &edit);
  return status.ok() ? apply(edit) : status;
}

}  // namespace inceres::tools
