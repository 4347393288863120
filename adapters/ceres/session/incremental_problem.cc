#include "adapters/ceres/session/incremental_problem.h"

#include <algorithm>
#include <vector>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/session/factor_matching.h"

namespace inceres::internal {

// One edit. Families come first, and the edit is begun after them: a new one would make it stale.
Status IncrementalProblem::Follow(const ProblemNow& now, ProblemChanges* changes) {
  *changes = ProblemChanges();
  VariableMatching variables(now, trust_, solver_, &edit_, &known_, changes);
  FactorMatching factors(now, trust_, forgotten_, variables, &solver_, &edit_, &losses_, &known_,
                         changes);
  edit_.Restart();
  losses_.Begin();
  variables.Match();
  factors.Match();
  variables.AddThoseOf(factors.new_residuals());
  factors.Add();
  losses_.End();
  forgotten_.clear();
  num_landmarks_ = static_cast<int>(std::count_if(known_.variables.begin(), known_.variables.end(),
                                                  [](const Correspondence::Variable& variable) {
                                                    return variable.role == Role::kLandmark &&
                                                           !variable.constant;
                                                  }));
  return solver_.Apply(edit_);
}

void IncrementalProblem::WriteToUser(const ProblemView& view) const {
  for (std::size_t b = 0; b < view.blocks.size(); ++b) {
    const ParameterBlockView& block = view.blocks[b];
    if (block.reduced()) {
      std::copy_n(solver_.Values(known_.VariableOf(static_cast<int>(b)).id), block.ambient_size,
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
    const auto found = std::find_if(
        known_.variables.begin(), known_.variables.end(),
        [block](const Correspondence::Variable& variable) { return variable.user == block; });
    if (found == known_.variables.end()) {
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
  std::vector<const double*> values;
  for (const Correspondence::Factor& factor : known_.factors) {
    RememberingFamily& family = *known_.families[At(factor.family)].family;
    const auto first = known_.factor_variables.begin() + factor.first_variable;
    values.resize(At(family.num_slots()));
    std::transform(first, first + family.num_slots(), values.begin(),
                   [this](VariableId id) { return solver_.Values(id); });
    family.Remember(factor.id.index, values.data());
  }
  for (Correspondence::Variable& variable : known_.variables) {
    if (variable.manifold != nullptr && variable.tangent_size > 0) {
      variable.plus_jacobian = ReadPlusJacobian(*variable.manifold, solver_.Values(variable.id));
    }
  }
}

// For messages. A block that was constant from the first on, or is gone, is not among the
// variables.
std::string IncrementalProblem::NameOf(VariableId id) const {
  const auto found =
      std::find_if(known_.variables.begin(), known_.variables.end(),
                   [id](const Correspondence::Variable& variable) { return variable.id == id; });
  return found == known_.variables.end() ? "parameter block of variable " + std::to_string(id)
                                         : DescribeObject("parameter block", found->user);
}

}  // namespace inceres::internal
