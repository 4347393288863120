#pragma once

#include <cstddef>
#include <optional>
#include <unordered_set>
#include <vector>

#include "adapters/ceres/read/ceres_adapters.h"
#include "adapters/ceres/read/index.h"
#include "adapters/ceres/session/variable_matching.h"

namespace inceres::internal {

/// The residual blocks' half of following a problem, once the parameter blocks are matched: what
/// was known is taken out, and what is found again, or new, goes back in.
class FactorMatching {
 public:
  /// Chooses the families, and adds those that are new to the solver's graph. `forgotten`: cost
  /// functions that are not what they were, whatever they evaluate to.
  FactorMatching(const ProblemNow& now, Trust trust,
                 const std::unordered_set<const ceres::CostFunction*>& forgotten,
                 const VariableMatching& variables, IncrementalSolver* solver, GraphEdit* edit,
                 LossTable* losses, Correspondence* known, ProblemChanges* changes);

  /// What was known stays, as it is or to be linearized anew, or goes. After the variables' Match.
  void Match();
  /// In program order: those that are new to the graph. Their parameter blocks are to be added
  /// before they are.
  const std::vector<int>& new_residuals() const { return new_residuals_; }
  void Add();

 private:
  void ChooseFamilies(const ShapeTable& shapes);
  int FamilyOf(const FactorShape& shape, int landmark_slot);
  int FindOld(ceres::ResidualBlockId block);
  bool HasSameVariables(const Correspondence::Factor& factor,
                        const ResidualBlockView& residual) const;
  void Keep(const ResidualBlockView& residual, Correspondence::Factor factor);
  bool MustLinearize(const Correspondence::Factor& factor, const ResidualBlockView& residual);
  void RemoveRest();
  void AddFactor(int r);

  const ProblemView& view_;
  const Trust trust_;
  const std::unordered_set<const ceres::CostFunction*>& forgotten_;
  const VariableMatching& variables_;
  IncrementalSolver& solver_;
  GraphEdit& edit_;
  LossTable& losses_;
  Correspondence& known_;
  ProblemChanges& changes_;
  std::vector<int> family_of_;  // per residual block: into known_.families; -1 if fixed
  std::vector<Correspondence::Factor> old_factors_;
  std::vector<VariableId> old_factor_variables_;
  std::vector<char> seen_;  // per old factor
  std::optional<PointerIndex> old_index_;
  std::size_t next_old_ = 0;
  std::vector<int> new_residuals_;
  std::vector<const double*> values_;  // of the blocks of one residual block
};

}  // namespace inceres::internal
