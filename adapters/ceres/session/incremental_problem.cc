// The variables of a living problem, and the order of its edit. Its factors are in living_factors.cc.
#include "adapters/ceres/session/incremental_problem.h"

#include <algorithm>
#include <cstring>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {
namespace {

bool SameBits(const double* a, const double* b, int size) {
  return std::memcmp(a, b, At(size) * sizeof(double)) == 0;
}

// ∂(x ⊞ δ)/∂δ; empty if there is none.
void ReadPlusJacobian(const UserManifold& manifold, const double* x, std::vector<double>* jacobian) {
  jacobian->assign(At(AmbientSizeOf(manifold)) * At(TangentSizeOf(manifold)), 0.0);
  if (!PlusJacobianOf(manifold, x, jacobian->data())) {
    jacobian->clear();
  }
}

}  // namespace

Status IncrementalProblem::Follow(const ProblemNow& now, ProblemChanges* changes) {
  *changes = ProblemChanges();
  ChooseRoles(now);
  ChooseFamilies(now);
  edit_.Restart();  // after the last AddFamily: it would make the edit stale
  losses_.Begin();
  MatchVariables(now.view, changes);
  MatchFactors(now.view, changes);
  RemoveRest(changes);
  AddVariables(now.view, changes);
  AddFactors(now.view, changes);
  losses_.End();
  forgotten_.clear();
  manifolds_ = {};
  num_landmarks_ = static_cast<int>(std::count_if(variables_.begin(), variables_.end(), [](const Variable& variable) {
    return variable.role == Role::kLandmark && !variable.constant;
  }));
  return solver_.Apply(edit_);
}

void IncrementalProblem::ChooseRoles(const ProblemNow& now) {
  past_roles_.assign(now.view.blocks.size(), PastRole::kNone);
  for (const Variable& variable : variables_) {
    const int b = now.view.index.Find(variable.user);
    if (b >= 0) {
      past_roles_[At(b)] = variable.role == Role::kLandmark && now.view.block(b).tangent_size == variable.tangent_size
                               ? PastRole::kLandmark
                               : PastRole::kFrame;
    }
  }
  roles_ = ChooseIncrementalRoles(now.view, now.landmarks, now.landmarks_given, past_roles_);
}

void IncrementalProblem::MatchVariables(const ProblemView& view, ProblemChanges* changes) {
  old_variables_.swap(variables_);
  variables_.clear();
  revalued_.clear();
  variable_of_.assign(view.blocks.size(), -1);
  going_.assign(At(solver_.graph().num_variables()), 0);
  for (Variable& variable : old_variables_) {
    const int b = view.index.Find(variable.user);
    const bool wanted = b >= 0 && (view.block(b).constant || view.block(b).degree > 0);
    if (wanted && IsSame(variable, view.block(b), roles_[At(b)])) {
      TakeOver(view.block(b), b, std::move(variable), changes);
    } else {
      edit_.RemoveVariable(variable.id);
      going_[At(variable.id)] = 1;
      ++changes->num_removed_variables;
    }
  }
}

// The same space at the same address: what is cached about its tangents holds. Values are another matter.
bool IncrementalProblem::IsSame(const Variable& variable, const ParameterBlockView& block, Role role) const {
  if (variable.ambient_size != block.ambient_size || variable.tangent_size != block.tangent_size ||
      variable.manifold != block.manifold || variable.role != role) {
    return false;
  }
  if (block.manifold == nullptr || block.tangent_size == 0 || trust_ == Trust::kAddresses) {
    return true;
  }
  std::vector<double> plus_jacobian;
  ReadPlusJacobian(*block.manifold, solver_.Values(variable.id), &plus_jacobian);
  return !plus_jacobian.empty() && plus_jacobian.size() == variable.plus_jacobian.size() &&
         SameBits(plus_jacobian.data(), variable.plus_jacobian.data(), static_cast<int>(plus_jacobian.size()));
}

void IncrementalProblem::TakeOver(const ParameterBlockView& block, int b, Variable variable, ProblemChanges* changes) {
  if (variable.constant != block.constant) {
    variable.constant = block.constant;
    edit_.SetConstant(variable.id, block.constant);
    ++changes->num_toggled_constants;
  }
  const bool revalued = !SameBits(block.values, solver_.Values(variable.id), block.ambient_size);
  if (revalued) {
    edit_.SetValues(variable.id, block.values);
    ++changes->num_revalued_variables;
  }
  variable_of_[At(b)] = static_cast<int>(variables_.size());
  revalued_.push_back(revalued ? 1 : 0);
  variables_.push_back(std::move(variable));
}

// Blocks of the new residual blocks by first appearance, frames before landmarks: the order does not depend on addresses.
void IncrementalProblem::AddVariables(const ProblemView& view, ProblemChanges* changes) {
  for (const Role role : {Role::kFrame, Role::kLandmark}) {
    for (const NewFactor& added : new_factors_) {
      const ResidualBlockView& residual = view.residuals[At(added.residual)];
      for (int s = 0; s < residual.num_slots; ++s) {
        const int b = view.SlotsOf(residual)[s];
        if (variable_of_[At(b)] < 0 && roles_[At(b)] == role) {
          AddVariable(view.block(b), b, changes);
        }
      }
    }
  }
}

void IncrementalProblem::AddVariable(const ParameterBlockView& block, int b, ProblemChanges* changes) {
  Variable variable;
  variable.user = block.values;
  variable.manifold = block.manifold;
  variable.ambient_size = block.ambient_size;
  variable.tangent_size = block.tangent_size;
  variable.role = roles_[At(b)];
  variable.constant = block.constant;
  if (block.constant && trust_ == Trust::kNothing) {
    variable.id = edit_.AddBorrowedConstant(block.values, block.ambient_size);
  } else {
    variable.id = edit_.AddVariable(block.values, block.ambient_size, variable.role, manifolds_.Get(block.manifold));
    if (block.constant) {
      edit_.SetConstant(variable.id, true);
    }
  }
  variable_of_[At(b)] = static_cast<int>(variables_.size());
  revalued_.push_back(0);
  variables_.push_back(std::move(variable));
  ++changes->num_added_variables;
}

void IncrementalProblem::WriteToUser(const ProblemView& view) const {
  for (std::size_t b = 0; b < view.blocks.size(); ++b) {
    const ParameterBlockView& block = view.blocks[b];
    if (block.reduced()) {
      std::copy_n(solver_.Values(variables_[At(variable_of_[b])].id), block.ambient_size, block.values);
    }
  }
}

void IncrementalProblem::Remember() {
  if (trust_ != Trust::kVerified) {
    return;
  }
  for (Family& family : families_) {
    family.family->Remember();
  }
  for (Variable& variable : variables_) {
    if (variable.manifold != nullptr && variable.tangent_size > 0) {
      ReadPlusJacobian(*variable.manifold, solver_.Values(variable.id), &variable.plus_jacobian);
    }
  }
}

// For messages. A block that was constant from the first on, or is gone, is not among the variables.
std::string IncrementalProblem::NameOf(VariableId id) const {
  const auto found =
      std::find_if(variables_.begin(), variables_.end(), [id](const Variable& variable) { return variable.id == id; });
  return found == variables_.end() ? "parameter block of variable " + std::to_string(id)
                                   : DescribeObject("parameter block", found->user);
}

}  // namespace inceres::internal
