#pragma once

#include <functional>
#include <map>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

#include "inceres/ceres/cost_family.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/problem/losses.h"
#include "tools/replay/replay_step.h"

namespace inceres::tools {

/// What a factor graph needs to grow by the steps of a replay: families, manifolds and losses, made
/// when first used. The factors are the built-in analytic ones or the same as AutoDiff cost
/// functions. Variable ids are the replay's numbers, and the graph's state is laid out like a
/// replay's. One object grows one graph, which is empty at first.
class ReplayGraph {
 public:
  explicit ReplayGraph(bool autodiff) : autodiff_(autodiff) {}

  /// kInvalidArgument names the first factor whose shape has no AutoDiff version; the graph then
  /// lacks the step.
  Status Add(const ReplayStep& step, FactorGraph* graph);

  using AddFamilyFunction = std::function<FamilyId(std::shared_ptr<const FactorFamily>)>;
  using ApplyFunction = std::function<Status(const GraphEdit&)>;
  using ValueFunction = std::function<const double*(VariableId)>;
  /// The same for a graph that changes by transactions, like an IncrementalSolver's, which keeps
  /// the variables' present values itself: adds the step's new families, then applies one edit of
  /// `graph` with everything else. Fails where Add or `apply` does.
  Status AddAsEdit(const ReplayStep& step, const FactorGraph& graph, const ValueFunction& value,
                   const AddFamilyFunction& add_family, const ApplyFunction& apply);

  /// The factors of the step that AddAsEdit added last which may be wrong, and whether they are.
  const std::vector<std::pair<FactorId, bool>>& new_suspects() const { return new_suspects_; }

 private:
  using PriorShape = std::tuple<int, int, int>;  // rows, ambient size, tangent size

  // Calls visit(handle, measurement, sizes…) with the handle of the family for factors of this
  // shape, the factor's measurement, and the arguments of the family's constructor.
  template <typename Visit>
  Status VisitFamily(const ReplayFactor& factor, const Visit& visit);
  template <typename Visit>
  Status VisitAutoDiffFamily(const ReplayFactor& factor, const Visit& visit);
  // Takes note of the step's variables and makes its new families.
  Status Prepare(const ReplayStep& step, const AddFamilyFunction& add_family);
  // The step itself, into a FactorGraph or an edit of one.
  template <typename Target>
  Status AddStep(const ReplayStep& step, const ValueFunction& value, Target* target);

  std::shared_ptr<const Manifold> ManifoldOf(ReplayVariable::Kind kind);
  std::shared_ptr<const Loss> LossOf(const LossSpec& spec);
  void Note(FactorId id, const ReplayFactor& factor) {
    if (factor.is_suspect) {
      new_suspects_.emplace_back(id, factor.is_wrong);
    }
  }
  static void Note(int /*index*/, const ReplayFactor& /*factor*/) {}

  const bool autodiff_;
  std::vector<ReplayVariable::Kind> kinds_;
  std::vector<std::pair<FactorId, bool>> new_suspects_;
  std::map<ReplayVariable::Kind, std::shared_ptr<const Manifold>> manifolds_;
  std::map<LossSpec, std::shared_ptr<const Loss>> losses_;
  std::map<int, FamilyHandle<BalReprojectionFamily>> bal_;  // by tangent size of the camera
  FamilyHandle<InverseDepthReprojectionFamily> inverse_depth_;
  FamilyHandle<RelativePoseFamily> relative_pose_;
  std::map<const PinholeCamera*, FamilyHandle<PointReprojectionFamily>> points_;
  FamilyHandle<ImuFactorFamily> imu_;
  std::map<const StereoCamera*, FamilyHandle<StereoReprojectionFamily>> stereo_;
  FamilyHandle<PlanarRelativePoseFamily> planar_;
  std::map<PriorShape, FamilyHandle<DiagonalPriorFamily>> priors_;
  // by residual size, then the sizes of each slot
  std::map<std::vector<int>, FamilyHandle<CeresCostFamily>> autodiff_families_;
};

}  // namespace inceres::tools
