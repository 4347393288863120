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

// Where the batch solver has finished the solve, or the user has moved a block, the solver that
// remembers is elsewhere.
Status IncrementalProblem::Covariance(const std::vector<const double*>& parameter_blocks,
                                      const LiveCovarianceOptions& options,
                                      LiveCovariance* covariance) const {
  std::vector<VariableId> ids;
  for (const double* block : parameter_blocks) {
    const auto found =
        std::find_if(variables_.begin(), variables_.end(),
                     [block](const Variable& variable) { return variable.user == block; });
    if (found == variables_.end()) {
      return Status::Error(StatusCode::kInvalidArgument, DescribeObject("parameter block", block) +
                                                             " was not part of the last solve");
    }
    if (!std::equal(block, block + found->ambient_size, solver_.Values(found->id))) {
      return Status::Error(StatusCode::kInvalidArgument,
                           DescribeObject("parameter block", block) +
                               " is not where the session's solver has left it: it was moved, or "
                               "the batch solver has finished the solve");
    }
    ids.push_back(found->id);
  }
  return solver_.Covariance(ids, options, covariance);
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
