#include "adapters/ceres/session/variable_matching.h"

#include <algorithm>
#include <cstring>
#include <memory>
#include <utility>

#include "adapters/ceres/read/selection.h"

namespace inceres::internal {
namespace {

bool SameBits(const double* a, const double* b, std::size_t size) {
  return std::memcmp(a, b, size * sizeof(double)) == 0;
}

bool HasBounds(const ParameterBlockView& block) {
  return block.bounds != BoundsKind::kNone && !block.constant;
}

bool BoundsOnManifold(const ParameterBlockView& block) {
  return HasBounds(block) && block.manifold != nullptr;
}

// What a bounded block's manifold was found to be (NeedsExactMode).
std::shared_ptr<const Manifold> SelectionOf(const ParameterBlockView& block) {
  const std::vector<int> moved = MovedValues(block).value_or(std::vector<int>());
  std::vector<int> held;
  for (int k = 0; k < block.ambient_size; ++k) {
    if (!std::binary_search(moved.begin(), moved.end(), k)) {
      held.push_back(k);
    }
  }
  return std::make_shared<SubsetManifold>(block.ambient_size, held);
}

// Where two landmarks meet, those that the selection does not want give way; at most one is left
// then. A constant counts too: it may be variable in the next solve.
void Separate(const ProblemView& view, const LandmarkSelection& selection,
              std::vector<Role>* roles) {
  const auto is_landmark = [&](int b) { return (*roles)[At(b)] == Role::kLandmark; };
  for (const ResidualBlockView& residual : view.residuals) {
    const int* begin = view.SlotsOf(residual);
    const int* end = begin + residual.num_slots;
    if (std::count_if(begin, end, is_landmark) < 2) {
      continue;
    }
    bool taken = std::any_of(begin, end, [&](int b) { return selection.Contains(b); });
    for (const int* b = begin; b != end; ++b) {
      if (is_landmark(*b) && !selection.Contains(*b)) {
        (*roles)[At(*b)] = taken ? Role::kFrame : Role::kLandmark;
        taken = true;
      }
    }
  }
}

}  // namespace

std::vector<Role> ChooseIncrementalRoles(const ProblemView& view,
                                         const LandmarkSelection& selection, bool given,
                                         const std::vector<PastRole>& past) {
  std::vector<Role> roles(view.blocks.size(), Role::kFrame);
  for (std::size_t b = 0; b < view.blocks.size(); ++b) {
    const bool was_landmark = past[b] == PastRole::kLandmark;
    const bool selected = selection.is_landmark[b] != 0;
    if (view.blocks[b].constant ? was_landmark : (selected || (was_landmark && !given))) {
      roles[b] = Role::kLandmark;
    }
  }
  Separate(view, selection, &roles);
  return roles;
}

VariableMatching::VariableMatching(const ProblemNow& now, Trust trust,
                                   const IncrementalSolver& solver, GraphEdit* edit,
                                   Correspondence* known, ProblemChanges* changes)
    : view_(now.view),
      trust_(trust),
      solver_(solver),
      edit_(*edit),
      known_(*known),
      changes_(*changes) {
  std::vector<PastRole> past(view_.blocks.size(), PastRole::kNone);
  for (const Correspondence::Variable& variable : known_.variables) {
    const int b = view_.index.Find(variable.user);
    if (b >= 0) {
      const bool was_landmark =
          variable.role == Role::kLandmark && view_.block(b).tangent_size == variable.tangent_size;
      past[At(b)] = was_landmark ? PastRole::kLandmark : PastRole::kFrame;
    }
  }
  roles_ = ChooseIncrementalRoles(view_, now.landmarks, now.landmarks_given, past);
}

std::vector<double> ReadPlusJacobian(const UserManifold& manifold, const double* x) {
  std::vector<double> jacobian(At(AmbientSizeOf(manifold)) * At(TangentSizeOf(manifold)), 0.0);
  if (!PlusJacobianOf(manifold, x, jacobian.data())) {
    jacobian.clear();
  }
  return jacobian;
}

void VariableMatching::Match() {
  std::vector<Correspondence::Variable> old_variables;
  old_variables.swap(known_.variables);
  known_.variables.reserve(old_variables.size());
  known_.variable_of.assign(view_.blocks.size(), -1);
  going_.assign(At(solver_.graph().num_variables()), 0);
  for (Correspondence::Variable& variable : old_variables) {
    const int b = view_.index.Find(variable.user);
    const bool wanted = b >= 0 && (view_.block(b).constant || view_.block(b).degree > 0);
    if (wanted && IsSame(variable, view_.block(b), roles_[At(b)])) {
      TakeOver(b, std::move(variable));
    } else {
      edit_.RemoveVariable(variable.id);
      going_[At(variable.id)] = 1;
      ++changes_.num_removed_variables;
    }
  }
}

// The same space at the same address: what is cached about its tangents holds. Values are another
// matter.
bool VariableMatching::IsSame(const Correspondence::Variable& variable,
                              const ParameterBlockView& block, Role role) const {
  if (variable.ambient_size != block.ambient_size || variable.tangent_size != block.tangent_size ||
      variable.manifold != block.manifold || variable.role != role) {
    return false;
  }
  // Bounds that have come to a block on a manifold: it has to be on another one in the graph.
  if (BoundsOnManifold(block) && !variable.selects) {
    return false;
  }
  if (block.manifold == nullptr || block.tangent_size == 0 || trust_ == Trust::kAddresses) {
    return true;
  }
  const std::vector<double> plus_jacobian =
      ReadPlusJacobian(*block.manifold, solver_.Values(variable.id));
  return !plus_jacobian.empty() && plus_jacobian.size() == variable.plus_jacobian.size() &&
         SameBits(plus_jacobian.data(), variable.plus_jacobian.data(), plus_jacobian.size());
}

// Where the block starts: Ceres projects all values of a variable block, those too that its
// manifold holds and the core would leave where they are.
const double* VariableMatching::StartOf(const ParameterBlockView& block) {
  if (!HasBounds(block)) {
    return block.values;
  }
  const double* lower = view_.bounds.data() + block.first_bound;
  const double* upper = lower + block.ambient_size;
  start_.resize(At(block.ambient_size));
  for (int k = 0; k < block.ambient_size; ++k) {
    start_[At(k)] = std::min(std::max(block.values[k], lower[k]), upper[k]);
  }
  return start_.data();
}

// Those of a constant do not count, and come back with it.
bool VariableMatching::FollowBounds(const ParameterBlockView& block,
                                    Correspondence::Variable* variable) {
  std::vector<double> bounds;
  if (HasBounds(block)) {
    const auto first = view_.bounds.begin() + static_cast<std::ptrdiff_t>(block.first_bound);
    bounds.assign(first, first + 2 * std::ptrdiff_t{block.ambient_size});
  }
  if (bounds == variable->bounds) {
    return false;
  }
  const double* lower = bounds.empty() ? nullptr : bounds.data();
  const double* upper = bounds.empty() ? nullptr : lower + block.ambient_size;
  edit_.SetBounds(variable->id, lower, upper);
  variable->bounds = std::move(bounds);
  return true;
}

void VariableMatching::TakeOver(int b, Correspondence::Variable variable) {
  const ParameterBlockView& block = view_.block(b);
  if (variable.constant != block.constant) {
    variable.constant = block.constant;
    edit_.SetConstant(variable.id, block.constant);
    ++changes_.num_toggled_constants;
  }
  const double* start = StartOf(block);
  const bool revalued = !SameBits(start, solver_.Values(variable.id), At(block.ambient_size));
  if (revalued) {
    edit_.SetValues(variable.id, start);
    ++changes_.num_revalued_variables;
  }
  changes_.num_changed_bounds += FollowBounds(block, &variable) ? 1 : 0;
  Keep(b, std::move(variable), revalued);
}

void VariableMatching::Keep(int b, Correspondence::Variable variable, bool revalued) {
  known_.variable_of[At(b)] = static_cast<int>(known_.variables.size());
  revalued_.push_back(revalued ? 1 : 0);
  known_.variables.push_back(std::move(variable));
}

// Blocks of the new residual blocks by first appearance, frames before landmarks: the order does
// not depend on addresses.
void VariableMatching::AddThoseOf(const std::vector<int>& residuals) {
  for (const Role role : {Role::kFrame, Role::kLandmark}) {
    for (const int r : residuals) {
      const ResidualBlockView& residual = view_.residuals[At(r)];
      for (int s = 0; s < residual.num_slots; ++s) {
        const int b = view_.SlotsOf(residual)[s];
        if (known_.variable_of[At(b)] < 0 && roles_[At(b)] == role) {
          Add(b, role);
        }
      }
    }
  }
}

void VariableMatching::Add(int b, Role role) {
  const ParameterBlockView& block = view_.block(b);
  Correspondence::Variable variable;
  variable.user = block.values;
  variable.manifold = block.manifold;
  variable.ambient_size = block.ambient_size;
  variable.tangent_size = block.tangent_size;
  variable.role = role;
  variable.constant = block.constant;
  if (block.constant && trust_ == Trust::kNothing) {
    variable.id = edit_.AddBorrowedConstant(block.values, block.ambient_size);
  } else {
    variable.selects = BoundsOnManifold(block);
    variable.id =
        edit_.AddVariable(StartOf(block), block.ambient_size, role,
                          variable.selects ? SelectionOf(block) : manifolds_.Get(block.manifold));
    if (block.constant) {
      edit_.SetConstant(variable.id, true);
    }
    FollowBounds(block, &variable);
  }
  Keep(b, std::move(variable), /*revalued=*/false);
  ++changes_.num_added_variables;
}

}  // namespace inceres::internal
