#include "adapters/ceres/src/graph_builder.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "adapters/ceres/src/adapter_cache.h"
#include "adapters/ceres/src/ceres_adapters.h"
#include "adapters/ceres/src/cost_function_family.h"
#include "adapters/ceres/src/index.h"

namespace inceres::internal {
namespace {

class Builder {
 public:
  Builder(const ProblemView& view, const ShapeTable& shapes, const LandmarkSelection& landmarks, FactorGraph* graph)
      : view_(view), shapes_(shapes), landmarks_(landmarks), graph_(*graph), variable_of_(view.blocks.size(), -1) {}

  std::vector<StateBlock> Run() {
    AddVariables();
    SortByLandmark();
    AddFamilies();
    return std::move(state_blocks_);
  }

 private:
  // Blocks by first appearance: constants and frames are added as they come, landmarks wait.
  void AddVariables() {
    graph_.Reserve(static_cast<int>(view_.blocks.size()), view_.reduced.num_parameters);
    state_blocks_.reserve(At(view_.reduced.num_parameter_blocks));
    std::vector<int> landmark_blocks;
    landmark_blocks.reserve(At(landmarks_.num_landmarks));
    constexpr VariableId kWaiting = -2;
    for (const ResidualBlockView& residual : view_.residuals) {
      const bool brings_blocks = !residual.fixed && !residual.like_previous;
      for (int s = 0; brings_blocks && s < residual.num_slots; ++s) {
        const int b = view_.SlotsOf(residual)[s];
        if (variable_of_[At(b)] != -1) {
          continue;
        }
        if (landmarks_.Contains(b)) {
          variable_of_[At(b)] = kWaiting;
          landmark_blocks.push_back(b);
        } else {
          AddVariable(b, Role::kFrame);
        }
      }
    }
    first_landmark_ = graph_.num_variables();
    for (const int b : landmark_blocks) {
      AddVariable(b, Role::kLandmark);
    }
  }

  void AddVariable(int b, Role role) {
    const ParameterBlockView& block = view_.block(b);
    if (block.constant) {
      variable_of_[At(b)] = graph_.AddBorrowedConstant(block.values, block.ambient_size);
      return;
    }
    const VariableId id = graph_.AddVariable(block.values, block.ambient_size, role, manifolds_.Get(block.manifold));
    variable_of_[At(b)] = id;
    if (block.bounds != BoundsKind::kNone) {
      const double* lower = view_.bounds.data() + block.first_bound;
      graph_.SetBounds(id, lower, lower + block.ambient_size);
    }
    state_blocks_.push_back({block.values, graph_.StateOffset(id), block.ambient_size});
  }

  // Slot of the residual block's landmark, or -1.
  int LandmarkSlot(const ResidualBlockView& residual) const {
    const int* slots = view_.SlotsOf(residual);
    const int* found = std::find_if(slots, slots + residual.num_slots, [&](int b) { return landmarks_.Contains(b); });
    return found == slots + residual.num_slots ? -1 : static_cast<int>(found - slots);
  }

  // Counting sort of the residual blocks by landmark, those without one last; program order within each.
  void SortByLandmark() {
    const std::size_t num_residuals = view_.residuals.size();
    landmark_slot_.assign(num_residuals, -1);
    if (landmarks_.num_landmarks == 0) {
      order_.resize(At(view_.reduced.num_residual_blocks));
      int* next = order_.data();
      for (std::size_t r = 0; r < num_residuals; ++r) {
        if (!view_.residuals[r].fixed) {
          *next++ = static_cast<int>(r);
        }
      }
      return;
    }
    std::vector<int> bucket_of(num_residuals, -1);
    std::vector<int> next(At(landmarks_.num_landmarks) + 2, 0);
    for (std::size_t r = 0; r < num_residuals; ++r) {
      const ResidualBlockView& residual = view_.residuals[r];
      if (residual.fixed) {
        continue;
      }
      const int slot = LandmarkSlot(residual);
      landmark_slot_[r] = slot;
      bucket_of[r] = slot < 0 ? landmarks_.num_landmarks : variable_of_[At(view_.SlotsOf(residual)[slot])] - first_landmark_;
      ++next[At(bucket_of[r]) + 1];
    }
    for (std::size_t k = 1; k < next.size(); ++k) {
      next[k] += next[k - 1];
    }
    order_.resize(At(next.back()));
    for (std::size_t r = 0; r < num_residuals; ++r) {
      if (bucket_of[r] >= 0) {
        order_[At(next[At(bucket_of[r])]++)] = static_cast<int>(r);
      }
    }
  }

  void AddFamilies() {
    if (shapes_.shapes.size() == 1 && landmarks_.num_landmarks == 0) {
      AddFamily(order_);  // as the rest would find
      return;
    }
    // A family for each shape and slot of the landmark (slot -1: none): place numbers of the shapes, one more for each shape.
    std::vector<int> family_at(At(shapes_.num_places) + shapes_.shapes.size(), -1);
    std::vector<int> family_of(order_.size());
    std::vector<std::vector<int>> members;
    std::vector<std::size_t> sizes;
    for (std::size_t k = 0; k < order_.size(); ++k) {
      const std::size_t r = At(order_[k]);
      const int shape = shapes_.shape_of[r];
      int& family = family_at[At(shapes_.shapes[At(shape)].first_place + shape + 1 + landmark_slot_[r])];
      if (family < 0) {
        family = static_cast<int>(sizes.size());
        sizes.push_back(0);
      }
      family_of[k] = family;
      ++sizes[At(family)];
    }
    members.resize(sizes.size());
    for (std::size_t family = 0; family < sizes.size(); ++family) {
      members[family].reserve(sizes[family]);
    }
    for (std::size_t k = 0; k < order_.size(); ++k) {
      members[At(family_of[k])].push_back(order_[k]);
    }
    for (const std::vector<int>& residuals : members) {
      AddFamily(residuals);
    }
  }

  void AddFamily(const std::vector<int>& residuals) {
    const FactorShape& shape = shapes_.ShapeOf(At(residuals.front()));
    std::vector<const ceres::CostFunction*> costs(residuals.size());
    std::vector<VariableId> variables(residuals.size() * shape.slots.size());
    std::vector<std::shared_ptr<const Loss>> losses;  // none, or one for each factor
    VariableId* variable = variables.data();
    for (std::size_t k = 0; k < residuals.size(); ++k) {
      const ResidualBlockView& residual = view_.residuals[At(residuals[k])];
      const int* slots = view_.SlotsOf(residual);
      costs[k] = residual.cost;
      for (int s = 0; s < residual.num_slots; ++s) {
        *variable++ = variable_of_[At(slots[s])];
      }
      if (residual.loss != nullptr) {
        losses.resize(residuals.size());
        losses[k] = losses_.Get(residual.loss);
      }
    }
    const FamilyId id =
        graph_.AddFamily(std::make_shared<CostFunctionFamily>(shape.num_residuals, shape.slots, std::move(costs)));
    graph_.ConnectMany(id, std::move(variables), std::move(losses));
  }

  const ProblemView& view_;
  const ShapeTable& shapes_;
  const LandmarkSelection& landmarks_;
  FactorGraph& graph_;
  std::vector<VariableId> variable_of_;  // per parameter block
  VariableId first_landmark_ = 0;
  std::vector<int> landmark_slot_;  // per residual block
  std::vector<int> order_;          // residual blocks by landmark
  AdapterCache<Manifold, CeresManifold, UserManifold> manifolds_;
  AdapterCache<Loss, CeresLoss, ceres::LossFunction> losses_;
  std::vector<StateBlock> state_blocks_;
};

}  // namespace

std::vector<StateBlock> BuildGraph(const ProblemView& view, const ShapeTable& shapes, const LandmarkSelection& landmarks,
                                   FactorGraph* graph) {
  return Builder(view, shapes, landmarks, graph).Run();
}

void WriteToUser(const std::vector<StateBlock>& blocks, const double* state) {
  for (const StateBlock& block : blocks) {
    std::copy_n(state + block.offset, block.size, block.user);
  }
}

}  // namespace inceres::internal
