#include "adapters/ceres/session/incremental_problem.h"

#include <algorithm>

#include "adapters/ceres/read/index.h"

namespace inceres::internal {

// ∂(x ⊞ δ)/∂δ; empty if there is none.
std::vector<double> IncrementalProblem::ReadPlusJacobian(const UserManifold& manifold,
                                                         const double* x) {
  std::vector<double> jacobian(At(AmbientSizeOf(manifold)) * At(TangentSizeOf(manifold)), 0.0);
  if (!PlusJacobianOf(manifold, x, jacobian.data())) {
    jacobian.clear();
  }
  return jacobian;
}

void IncrementalProblem::WriteToUser(const ProblemView& view) const {
  for (std::size_t b = 0; b < view.blocks.size(); ++b) {
    const ParameterBlockView& block = view.blocks[b];
    if (block.reduced()) {
      std::copy_n(solver_.Values(variables_[At(variable_of_[b])].id), block.ambient_size,
                  block.values);
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
      variable.plus_jacobian = ReadPlusJacobian(*variable.manifold, solver_.Values(variable.id));
    }
  }
}

// For messages. A block that was constant from the first on, or is gone, is not among the
// variables.
std::string IncrementalProblem::NameOf(VariableId id) const {
  const auto found = std::find_if(variables_.begin(), variables_.end(),
                                  [id](const Variable& variable) { return variable.id == id; });
  return found == variables_.end() ? "parameter block of variable " + std::to_string(id)
                                   : DescribeObject("parameter block", found->user);
}

}  // namespace inceres::internal
