// How an IncrementalProblem is brought to where a ceres::Problem is.
#include <algorithm>
#include <cstring>
#include <optional>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/read/pointer_index.h"
#include "adapters/ceres/read/selection.h"
#include "adapters/ceres/session/incremental_problem.h"

namespace inceres::internal {
namespace {

bool SameBits(const double* a, const double* b, std::size_t size) {
  return std::memcmp(a, b, size * sizeof(double)) == 0;
}

bool HasShape(const FactorFamily& family, const FactorShape& shape) {
  if (family.residual_size() != shape.num_residuals ||
      family.num_slots() != static_cast<int>(shape.slots.size())) {
    return false;
  }
  for (int s = 0; s < family.num_slots(); ++s) {
    const FactorFamily::Slot& slot = shape.slots[At(s)];
    if (family.slot(s).ambient_size != slot.ambient_size ||
        family.slot(s).tangent_size != slot.tangent_size) {
      return false;
    }
  }
  return true;
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

// One call of Follow: what was known is taken out, and what is found again, or new, goes back in.
class IncrementalProblem::Follower {
 public:
  Follower(const ProblemNow& now, IncrementalProblem* problem, ProblemChanges* changes)
      : view_(now.view),
        problem_(*problem),
        solver_(problem->solver_),
        edit_(problem->edit_),
        changes_(*changes) {
    ChooseRoles(now);
    ChooseFamilies(now.shapes);
    edit_.Restart();  // after the last AddFamily: it would make the edit stale
  }

  void Run() {
    problem_.losses_.Begin();
    MatchVariables();
    MatchFactors();
    RemoveRest();
    AddVariables();
    AddFactors();
    problem_.losses_.End();
  }

 private:
  // A residual block that is new to the graph; by landmark (index into variables_; after all others
  // if there is none), then in program order.
  struct NewFactor {
    int landmark = -1;
    int residual = -1;
    bool operator<(const NewFactor& other) const {
      return landmark != other.landmark ? landmark < other.landmark : residual < other.residual;
    }
  };

  void ChooseRoles(const ProblemNow& now) {
    std::vector<PastRole> past(view_.blocks.size(), PastRole::kNone);
    for (const Variable& variable : problem_.variables_) {
      const int b = view_.index.Find(variable.user);
      if (b >= 0) {
        const bool was_landmark = variable.role == Role::kLandmark &&
                                  view_.block(b).tangent_size == variable.tangent_size;
        past[At(b)] = was_landmark ? PastRole::kLandmark : PastRole::kFrame;
      }
    }
    roles_ = ChooseIncrementalRoles(view_, now.landmarks, now.landmarks_given, past);
  }

  // A family for each shape and slot of the landmark (slot -1: none), as in an exact solve.
  void ChooseFamilies(const ShapeTable& shapes) {
    family_of_.assign(view_.residuals.size(), -1);
    std::vector<int> family_at(At(shapes.num_places) + shapes.shapes.size(), -1);
    for (std::size_t r = 0; r < view_.residuals.size(); ++r) {
      const ResidualBlockView& residual = view_.residuals[r];
      if (residual.fixed) {
        continue;
      }
      const int landmark_slot =
          view_.FindSlot(residual, [this](int b) { return roles_[At(b)] == Role::kLandmark; });
      const FactorShape& shape = shapes.ShapeOf(r);
      int& family = family_at[At(shape.first_place + shapes.shape_of[r] + 1 + landmark_slot)];
      if (family < 0) {
        family = FamilyOf(shape, landmark_slot);
      }
      family_of_[r] = family;
    }
  }

  int FamilyOf(const FactorShape& shape, int landmark_slot) {
    std::vector<Family>& families = problem_.families_;
    const auto found = std::find_if(families.begin(), families.end(), [&](const Family& family) {
      return family.landmark_slot == landmark_slot && HasShape(*family.family, shape);
    });
    if (found != families.end()) {
      return static_cast<int>(found - families.begin());
    }
    Family family;
    family.family = std::make_shared<RememberingFamily>(shape.num_residuals, shape.slots,
                                                        problem_.trust_ == Trust::kVerified);
    family.landmark_slot = landmark_slot;
    family.id = solver_.AddFamily(family.family);
    families.push_back(std::move(family));
    return static_cast<int>(families.size()) - 1;
  }

  void MatchVariables() {
    std::vector<Variable> old_variables;
    old_variables.swap(problem_.variables_);
    problem_.variables_.reserve(old_variables.size());
    problem_.variable_of_.assign(view_.blocks.size(), -1);
    going_.assign(At(solver_.graph().num_variables()), 0);
    for (Variable& variable : old_variables) {
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
  bool IsSame(const Variable& variable, const ParameterBlockView& block, Role role) const {
    if (variable.ambient_size != block.ambient_size ||
        variable.tangent_size != block.tangent_size || variable.manifold != block.manifold ||
        variable.role != role) {
      return false;
    }
    // Bounds that have come to a block on a manifold: it has to be on another one in the graph.
    if (BoundsOnManifold(block) && !variable.selects) {
      return false;
    }
    if (block.manifold == nullptr || block.tangent_size == 0 ||
        problem_.trust_ == Trust::kAddresses) {
      return true;
    }
    const std::vector<double> plus_jacobian =
        ReadPlusJacobian(*block.manifold, solver_.Values(variable.id));
    return !plus_jacobian.empty() && plus_jacobian.size() == variable.plus_jacobian.size() &&
           SameBits(plus_jacobian.data(), variable.plus_jacobian.data(), plus_jacobian.size());
  }

  static bool BoundsOnManifold(const ParameterBlockView& block) {
    return block.bounds != BoundsKind::kNone && !block.constant && block.manifold != nullptr;
  }

  // Where the block starts: Ceres projects all values of a variable block, those too that its
  // manifold holds and the core would leave where they are.
  const double* StartOf(const ParameterBlockView& block) {
    if (block.bounds == BoundsKind::kNone || block.constant) {
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
  bool FollowBounds(const ParameterBlockView& block, Variable* variable) {
    std::vector<double> bounds;
    if (block.bounds != BoundsKind::kNone && !block.constant) {
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

  void TakeOver(int b, Variable variable) {
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

  void Keep(int b, Variable variable, bool revalued) {
    problem_.variable_of_[At(b)] = static_cast<int>(problem_.variables_.size());
    revalued_.push_back(revalued ? 1 : 0);
    problem_.variables_.push_back(std::move(variable));
  }

  const Variable& VariableOf(int b) const {
    return problem_.variables_[At(problem_.variable_of_[At(b)])];
  }

  void MatchFactors() {
    old_factors_.swap(problem_.factors_);
    old_factor_variables_.swap(problem_.factor_variables_);
    problem_.factors_.reserve(view_.residuals.size());
    problem_.factor_variables_.reserve(old_factor_variables_.size());
    seen_.assign(old_factors_.size(), 0);
    problem_.factor_of_.assign(view_.residuals.size(), -1);
    for (std::size_t r = 0; r < view_.residuals.size(); ++r) {
      const ResidualBlockView& residual = view_.residuals[r];
      const int old = FindOld(residual.id);
      if (old >= 0 && HasSameVariables(old_factors_[At(old)], residual)) {
        seen_[At(old)] = 1;
        problem_.factor_of_[r] = static_cast<int>(problem_.factors_.size());
        Keep(residual, old_factors_[At(old)]);
      } else if (!residual.fixed) {
        new_factors_.push_back({-1, static_cast<int>(r)});
      }
    }
  }

  // The residual blocks mostly stand in the order of last time; where they do not, a hash table is
  // built, once a solve.
  int FindOld(ceres::ResidualBlockId block) {
    if (next_old_ < old_factors_.size() && old_factors_[next_old_].block == block) {
      return static_cast<int>(next_old_++);
    }
    if (!old_index_) {
      std::vector<ceres::ResidualBlockId> old_blocks;
      for (const Factor& factor : old_factors_) {
        old_blocks.push_back(factor.block);
      }
      old_index_.emplace().Build(old_blocks);
    }
    const int old = old_index_->Find(block);
    if (old >= 0) {
      next_old_ = At(old) + 1;
    }
    return old;
  }

  bool HasSameVariables(const Factor& factor, const ResidualBlockView& residual) const {
    const RememberingFamily& family = *problem_.families_[At(factor.family)].family;
    if (family.residual_size() != residual.num_residuals ||
        family.num_slots() != residual.num_slots) {
      return false;
    }
    for (int s = 0; s < residual.num_slots; ++s) {
      const int b = view_.SlotsOf(residual)[s];
      if (problem_.variable_of_[At(b)] < 0 ||
          VariableOf(b).id != old_factor_variables_[At(factor.first_variable + s)]) {
        return false;
      }
    }
    return true;
  }

  // A residual block that stays in the graph: as it is if it is proved to be the same, else to be
  // linearized anew.
  void Keep(const ResidualBlockView& residual, Factor factor) {
    if (MustLinearize(factor, residual)) {
      factor.cost = residual.cost;
      problem_.families_[At(factor.family)].family->PlaceBorrowed(factor.id.index, residual.cost);
      edit_.MeasurementChanged(factor.id);
      ++changes_.num_replaced_factors;
    } else {
      ++changes_.num_kept_factors;
    }
    const std::shared_ptr<const Loss>& loss = problem_.losses_.Get(residual.loss);
    if (loss.get() != factor.loss) {
      factor.loss = loss.get();
      edit_.SetLoss(factor.id, loss);
      ++changes_.num_changed_losses;
    }
    const auto first = old_factor_variables_.begin() + factor.first_variable;
    std::vector<VariableId>& variables = problem_.factor_variables_;
    factor.first_variable = static_cast<int>(variables.size());
    variables.insert(variables.end(), first, first + residual.num_slots);
    problem_.factors_.push_back(factor);
  }

  bool MustLinearize(const Factor& factor, const ResidualBlockView& residual) {
    if (factor.cost != residual.cost || problem_.forgotten_.count(residual.cost) != 0) {
      return true;
    }
    if (problem_.trust_ == Trust::kAddresses) {
      return false;
    }
    // Where the caller has set other values the solver linearizes anew anyway: nothing cached needs
    // a proof.
    const int* slots = view_.SlotsOf(residual);
    const bool revalued = std::any_of(slots, slots + residual.num_slots, [this](int b) {
      return revalued_[At(problem_.variable_of_[At(b)])] != 0;
    });
    return !revalued &&
           !problem_.families_[At(factor.family)].family->Recognize(factor.id.index, residual.cost);
  }

  // What was not met again goes; what touches a variable that goes does so by itself.
  void RemoveRest() {
    for (std::size_t i = 0; i < old_factors_.size(); ++i) {
      if (seen_[i] != 0) {
        continue;
      }
      const Factor& factor = old_factors_[i];
      RememberingFamily& family = *problem_.families_[At(factor.family)].family;
      const auto first = old_factor_variables_.begin() + factor.first_variable;
      if (std::none_of(first, first + family.num_slots(),
                       [this](VariableId id) { return going_[At(id)] != 0; })) {
        edit_.RemoveFactor(factor.id);
      }
      family.PlaceBorrowed(factor.id.index, nullptr);  // the cost function may be gone
      ++changes_.num_removed_factors;
    }
  }

  // Blocks of the new residual blocks by first appearance, frames before landmarks: the order does
  // not depend on addresses.
  void AddVariables() {
    for (const Role role : {Role::kFrame, Role::kLandmark}) {
      for (const NewFactor& added : new_factors_) {
        const ResidualBlockView& residual = view_.residuals[At(added.residual)];
        for (int s = 0; s < residual.num_slots; ++s) {
          const int b = view_.SlotsOf(residual)[s];
          if (problem_.variable_of_[At(b)] < 0 && roles_[At(b)] == role) {
            AddVariable(b, role);
          }
        }
      }
    }
  }

  void AddVariable(int b, Role role) {
    const ParameterBlockView& block = view_.block(b);
    Variable variable;
    variable.user = block.values;
    variable.manifold = block.manifold;
    variable.ambient_size = block.ambient_size;
    variable.tangent_size = block.tangent_size;
    variable.role = role;
    variable.constant = block.constant;
    if (block.constant && problem_.trust_ == Trust::kNothing) {
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

  // What a bounded block's manifold was found to be (NeedsExactMode).
  static std::shared_ptr<const Manifold> SelectionOf(const ParameterBlockView& block) {
    const std::vector<int> moved = MovedValues(block).value_or(std::vector<int>());
    std::vector<int> held;
    for (int k = 0; k < block.ambient_size; ++k) {
      if (!std::binary_search(moved.begin(), moved.end(), k)) {
        held.push_back(k);
      }
    }
    return std::make_shared<SubsetManifold>(block.ambient_size, held);
  }

  void AddFactors() {
    for (NewFactor& added : new_factors_) {
      const int landmark_slot =
          problem_.families_[At(family_of_[At(added.residual)])].landmark_slot;
      const int* slots = view_.SlotsOf(view_.residuals[At(added.residual)]);
      added.landmark = landmark_slot < 0 ? static_cast<int>(problem_.variables_.size())
                                         : problem_.variable_of_[At(slots[landmark_slot])];
    }
    const std::size_t first_new = problem_.factors_.size();
    for (std::size_t k = 0; k < new_factors_.size(); ++k) {
      problem_.factor_of_[At(new_factors_[k].residual)] = static_cast<int>(first_new + k);
    }
    problem_.factors_.resize(first_new + new_factors_.size());
    std::sort(new_factors_.begin(), new_factors_.end());
    for (const NewFactor& added : new_factors_) {
      AddFactor(added.residual);
    }
  }

  void AddFactor(int r) {
    const ResidualBlockView& residual = view_.residuals[At(r)];
    const std::shared_ptr<const Loss>& loss = problem_.losses_.Get(residual.loss);
    std::vector<VariableId>& variables = problem_.factor_variables_;
    Factor& factor = problem_.factors_[At(problem_.factor_of_[At(r)])];
    factor.block = residual.id;
    factor.cost = residual.cost;
    factor.loss = loss.get();
    factor.family = family_of_[At(r)];
    factor.first_variable = static_cast<int>(variables.size());
    for (int s = 0; s < residual.num_slots; ++s) {
      variables.push_back(VariableOf(view_.SlotsOf(residual)[s]).id);
    }
    const Family& family = problem_.families_[At(factor.family)];
    factor.id = edit_.Connect(family.id, variables.data() + factor.first_variable, loss);
    family.family->PlaceBorrowed(factor.id.index, residual.cost);
    ++changes_.num_added_factors;
  }

  const ProblemView& view_;
  IncrementalProblem& problem_;
  IncrementalSolver& solver_;
  GraphEdit& edit_;
  ProblemChanges& changes_;
  std::vector<Role> roles_;     // per block
  std::vector<int> family_of_;  // per residual block: into families_; -1 if fixed
  std::vector<char> revalued_;  // per entry of variables_
  std::vector<char> going_;     // per variable id
  std::vector<Factor> old_factors_;
  std::vector<VariableId> old_factor_variables_;
  std::vector<double> start_;  // StartOf
  std::vector<char> seen_;     // per old factor
  std::optional<PointerIndex> old_index_;
  std::size_t next_old_ = 0;
  std::vector<NewFactor> new_factors_;
  ManifoldTable manifolds_;
};

Status IncrementalProblem::Follow(const ProblemNow& now, ProblemChanges* changes) {
  *changes = ProblemChanges();
  Follower(now, this, changes).Run();
  forgotten_.clear();
  num_landmarks_ = static_cast<int>(
      std::count_if(variables_.begin(), variables_.end(), [](const Variable& variable) {
        return variable.role == Role::kLandmark && !variable.constant;
      }));
  return solver_.Apply(edit_);
}

}  // namespace inceres::internal
