#include "adapters/ceres/session/factor_matching.h"

#include <algorithm>
#include <memory>
#include <utility>

namespace inceres::internal {
namespace {

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

}  // namespace

FactorMatching::FactorMatching(const ProblemNow& now, Trust trust,
                               const std::unordered_set<const ceres::CostFunction*>& forgotten,
                               const VariableMatching& variables, IncrementalSolver* solver,
                               GraphEdit* edit, LossTable* losses, Correspondence* known,
                               ProblemChanges* changes)
    : view_(now.view),
      trust_(trust),
      forgotten_(forgotten),
      variables_(variables),
      solver_(*solver),
      edit_(*edit),
      losses_(*losses),
      known_(*known),
      changes_(*changes) {
  ChooseFamilies(now.shapes);
}

// A family for each shape and slot of the landmark (slot -1: none), as in an exact solve.
void FactorMatching::ChooseFamilies(const ShapeTable& shapes) {
  const std::vector<Role>& roles = variables_.roles();
  family_of_.assign(view_.residuals.size(), -1);
  std::vector<int> family_at(At(shapes.num_places) + shapes.shapes.size(), -1);
  for (std::size_t r = 0; r < view_.residuals.size(); ++r) {
    const ResidualBlockView& residual = view_.residuals[r];
    if (residual.fixed) {
      continue;
    }
    const int landmark_slot =
        view_.FindSlot(residual, [&roles](int b) { return roles[At(b)] == Role::kLandmark; });
    const FactorShape& shape = shapes.ShapeOf(r);
    int& family = family_at[At(shape.first_place + shapes.shape_of[r] + 1 + landmark_slot)];
    if (family < 0) {
      family = FamilyOf(shape, landmark_slot);
    }
    family_of_[r] = family;
  }
}

int FactorMatching::FamilyOf(const FactorShape& shape, int landmark_slot) {
  std::vector<Correspondence::Family>& families = known_.families;
  const auto found =
      std::find_if(families.begin(), families.end(), [&](const Correspondence::Family& family) {
        return family.landmark_slot == landmark_slot && HasShape(*family.family, shape);
      });
  if (found != families.end()) {
    return static_cast<int>(found - families.begin());
  }
  Correspondence::Family family;
  family.family = std::make_shared<RememberingFamily>(shape.num_residuals, shape.slots,
                                                      trust_ == Trust::kVerified);
  family.landmark_slot = landmark_slot;
  family.id = solver_.AddFamily(family.family);
  families.push_back(std::move(family));
  return static_cast<int>(families.size()) - 1;
}

void FactorMatching::Match() {
  old_factors_.swap(known_.factors);
  old_factor_variables_.swap(known_.factor_variables);
  known_.factors.reserve(view_.residuals.size());
  known_.factor_variables.reserve(old_factor_variables_.size());
  seen_.assign(old_factors_.size(), 0);
  known_.factor_of.assign(view_.residuals.size(), -1);
  for (std::size_t r = 0; r < view_.residuals.size(); ++r) {
    const ResidualBlockView& residual = view_.residuals[r];
    // The cost of one that is fixed now may be so large that what moves is below its last digit.
    if (residual.fixed) {
      continue;
    }
    const int old = FindOld(view_.ids[r]);
    if (old >= 0 && HasSameVariables(old_factors_[At(old)], residual)) {
      seen_[At(old)] = 1;
      known_.factor_of[r] = static_cast<int>(known_.factors.size());
      Keep(residual, old_factors_[At(old)]);
    } else {
      new_residuals_.push_back(static_cast<int>(r));
    }
  }
  RemoveRest();
}

// The residual blocks mostly stand in the order of last time; where they do not, a hash table is
// built, once a solve.
int FactorMatching::FindOld(ceres::ResidualBlockId block) {
  if (next_old_ < old_factors_.size() && old_factors_[next_old_].block == block) {
    return static_cast<int>(next_old_++);
  }
  if (!old_index_) {
    std::vector<ceres::ResidualBlockId> old_blocks;
    for (const Correspondence::Factor& factor : old_factors_) {
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

bool FactorMatching::HasSameVariables(const Correspondence::Factor& factor,
                                      const ResidualBlockView& residual) const {
  const RememberingFamily& family = *known_.families[At(factor.family)].family;
  if (family.residual_size() != residual.num_residuals ||
      family.num_slots() != residual.num_slots) {
    return false;
  }
  for (int s = 0; s < residual.num_slots; ++s) {
    const int b = view_.SlotsOf(residual)[s];
    if (known_.variable_of[At(b)] < 0 ||
        known_.VariableOf(b).id != old_factor_variables_[At(factor.first_variable + s)]) {
      return false;
    }
  }
  return true;
}

// A residual block that stays in the graph: as it is if it is proved to be the same, else to be
// linearized anew.
void FactorMatching::Keep(const ResidualBlockView& residual, Correspondence::Factor factor) {
  if (MustLinearize(factor, residual)) {
    factor.cost = residual.cost;
    known_.families[At(factor.family)].family->PlaceBorrowed(factor.id.index, residual.cost);
    edit_.MeasurementChanged(factor.id);
    ++changes_.num_replaced_factors;
  } else {
    ++changes_.num_kept_factors;
  }
  const std::shared_ptr<const Loss>& loss = losses_.Get(residual.loss);
  if (loss.get() != factor.loss) {
    factor.loss = loss.get();
    edit_.SetLoss(factor.id, loss);
    ++changes_.num_changed_losses;
  }
  const auto first = old_factor_variables_.begin() + factor.first_variable;
  std::vector<VariableId>& variables = known_.factor_variables;
  factor.first_variable = static_cast<int>(variables.size());
  variables.insert(variables.end(), first, first + residual.num_slots);
  known_.factors.push_back(factor);
}

bool FactorMatching::MustLinearize(const Correspondence::Factor& factor,
                                   const ResidualBlockView& residual) {
  if (factor.cost != residual.cost || forgotten_.count(residual.cost) != 0) {
    return true;
  }
  if (trust_ == Trust::kAddresses) {
    return false;
  }
  // Where the caller has set other values the solver linearizes anew anyway: nothing cached needs
  // a proof.
  const int* slots = view_.SlotsOf(residual);
  const bool revalued = std::any_of(slots, slots + residual.num_slots,
                                    [this](int b) { return variables_.IsRevalued(b); });
  RememberingFamily& family = *known_.families[At(factor.family)].family;
  if (revalued) {
    // It is linearized anyway, and not asked whether it is the same function still.
    family.Doubt(factor.id.index);
    return false;
  }
  values_.resize(At(residual.num_slots));
  std::transform(slots, slots + residual.num_slots, values_.begin(),
                 [this](int b) { return view_.block(b).values; });
  return !family.Recognize(factor.id.index, residual.cost, values_.data());
}

// What was not met again goes; what touches a variable that goes does so by itself.
void FactorMatching::RemoveRest() {
  for (std::size_t i = 0; i < old_factors_.size(); ++i) {
    if (seen_[i] != 0) {
      continue;
    }
    const Correspondence::Factor& factor = old_factors_[i];
    RememberingFamily& family = *known_.families[At(factor.family)].family;
    const auto first = old_factor_variables_.begin() + factor.first_variable;
    if (std::none_of(first, first + family.num_slots(),
                     [this](VariableId id) { return variables_.Goes(id); })) {
      edit_.RemoveFactor(factor.id);
    }
    family.PlaceBorrowed(factor.id.index, nullptr);  // the cost function may be gone
    ++changes_.num_removed_factors;
  }
}

// By landmark, after all others those without one, then in program order: what is eliminated
// together lies together.
void FactorMatching::Add() {
  std::vector<std::pair<int, int>> by_landmark;  // index into known_.variables, residual block
  for (const int r : new_residuals_) {
    known_.factor_of[At(r)] = static_cast<int>(known_.factors.size() + by_landmark.size());
    const int landmark_slot = known_.families[At(family_of_[At(r)])].landmark_slot;
    const int* slots = view_.SlotsOf(view_.residuals[At(r)]);
    by_landmark.emplace_back(landmark_slot < 0 ? static_cast<int>(known_.variables.size())
                                               : known_.variable_of[At(slots[landmark_slot])],
                             r);
  }
  known_.factors.resize(known_.factors.size() + by_landmark.size());
  std::sort(by_landmark.begin(), by_landmark.end());
  for (const auto& [landmark, r] : by_landmark) {
    AddFactor(r);
  }
}

void FactorMatching::AddFactor(int r) {
  const ResidualBlockView& residual = view_.residuals[At(r)];
  const std::shared_ptr<const Loss>& loss = losses_.Get(residual.loss);
  std::vector<VariableId>& variables = known_.factor_variables;
  Correspondence::Factor& factor = known_.factors[At(known_.factor_of[At(r)])];
  factor.block = view_.ids[At(r)];
  factor.cost = residual.cost;
  factor.loss = loss.get();
  factor.family = family_of_[At(r)];
  factor.first_variable = static_cast<int>(variables.size());
  for (int s = 0; s < residual.num_slots; ++s) {
    variables.push_back(known_.VariableOf(view_.SlotsOf(residual)[s]).id);
  }
  const Correspondence::Family& family = known_.families[At(factor.family)];
  factor.id = edit_.Connect(family.id, variables.data() + factor.first_variable, loss);
  family.family->PlaceBorrowed(factor.id.index, residual.cost);
  ++changes_.num_added_factors;
}

}  // namespace inceres::internal
