#pragma once

#include <map>
#include <memory>
#include <tuple>
#include <vector>

#include "inceres/graph/factor_graph.h"
#include "inceres/graph/losses.h"
#include "tools/common/replay_step.h"

namespace inceres::tools {

/// A factor graph of built-in analytic factors that grows by the steps of a replay. Variable ids are the replay's numbers, and
/// the graph's state is laid out like a replay's.
class ReplayGraph {
 public:
  /// Grows this graph, empty so far, which outlives the object.
  explicit ReplayGraph(FactorGraph* graph) : graph_(*graph) {}
  void Add(const ReplayStep& step);

 private:
  // A family and its id in the graph, made when first used.
  template <typename Family>
  struct Member {
    FamilyId id = -1;
    std::shared_ptr<Family> family;
  };
  using PriorShape = std::tuple<int, int, int>;  // rows, ambient size, tangent size

  template <typename Family, typename... Arguments>
  void AddTo(Member<Family>* member, const typename Family::Measurement& measurement, const ReplayFactor& factor,
             Arguments... arguments);
  void AddFactor(const ReplayFactor& factor);
  std::shared_ptr<const Manifold> ManifoldOf(ReplayVariable::Kind kind);
  std::shared_ptr<const Loss> LossOf(double huber);

  FactorGraph& graph_;
  std::vector<ReplayVariable::Kind> kinds_;
  std::map<ReplayVariable::Kind, std::shared_ptr<const Manifold>> manifolds_;
  std::map<double, std::shared_ptr<const Loss>> losses_;
  std::map<int, Member<BalReprojectionFamily>> bal_;  // by tangent size of the camera
  Member<InverseDepthReprojectionFamily> inverse_depth_;
  Member<RelativePoseFamily> relative_pose_;
  std::map<PriorShape, Member<DiagonalPriorFamily>> priors_;
};

}  // namespace inceres::tools
