// The factors of a living problem.
#include <algorithm>

#include "adapters/ceres/read/index.h"
#include "adapters/ceres/session/incremental_problem.h"

namespace inceres::internal {
namespace {

bool SameSlots(const std::vector<FactorFamily::Slot>& a, const std::vector<FactorFamily::Slot>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](const FactorFamily::Slot& x, const FactorFamily::Slot& y) {
    return x.ambient_size == y.ambient_size && x.tangent_size == y.tangent_size;
  });
}

}  // namespace

// A family for each shape and slot of the landmark (slot -1: none), as in an exact solve.
void IncrementalProblem::ChooseFamilies(const ProblemNow& now) {
  family_of_.assign(now.view.residuals.size(), -1);
  family_at_.assign(At(now.shapes.num_places) + now.shapes.shapes.size(), -1);
  for (std::size_t r = 0; r < now.view.residuals.size(); ++r) {
    const ResidualBlockView& residual = now.view.residuals[r];
    if (residual.fixed) {
      continue;
    }
    const int* slots = now.view.SlotsOf(residual);
    const int* landmark = std::find_if(slots, slots + residual.num_slots, [this](int b) { return IsLandmark(b); });
    const int landmark_slot = landmark == slots + residual.num_slots ? -1 : static_cast<int>(landmark - slots);
    const int shape = now.shapes.shape_of[r];
    int& family = family_at_[At(now.shapes.ShapeOf(r).first_place + shape + 1 + landmark_slot)];
    if (family < 0) {
      family = FamilyOf(now.shapes.ShapeOf(r), landmark_slot);
    }
    family_of_[r] = family;
  }
}

int IncrementalProblem::FamilyOf(const FactorShape& shape, int landmark_slot) {
  const auto found = std::find_if(families_.begin(), families_.end(), [&](const Family& family) {
    return family.family->residual_size() == shape.num_residuals && family.landmark_slot == landmark_slot &&
           SameSlots(family.slots, shape.slots);
  });
  if (found != families_.end()) {
    return static_cast<int>(found - families_.begin());
  }
  Family family;
  family.family = std::make_shared<RememberingFamily>(shape.num_residuals, shape.slots, trust_ == Trust::kVerified);
  family.slots = shape.slots;
  family.landmark_slot = landmark_slot;
  family.id = solver_.AddFamily(family.family);
  families_.push_back(std::move(family));
  return static_cast<int>(families_.size()) - 1;
}

void IncrementalProblem::MatchFactors(const ProblemView& view, ProblemChanges* changes) {
  old_factors_.swap(factors_);
  old_factor_variables_.swap(factor_variables_);
  factors_.clear();
  factor_variables_.clear();
  new_factors_.clear();
  seen_.assign(old_factors_.size(), 0);
  factor_of_.assign(view.residuals.size(), -1);
  old_index_built_ = false;
  next_old_ = 0;
  for (std::size_t r = 0; r < view.residuals.size(); ++r) {
    const ResidualBlockView& residual = view.residuals[r];
    const int old = FindOld(residual.id);
    if (old >= 0 && HasSameVariables(old_factors_[At(old)], view, residual)) {
      seen_[At(old)] = 1;
      factor_of_[r] = static_cast<int>(factors_.size());
      Keep(view, residual, old_factors_[At(old)], changes);
    } else if (!residual.fixed) {
      new_factors_.push_back({-1, static_cast<int>(r)});
    }
  }
}

// The residual blocks mostly stand in the order of last time; where they do not, a hash table is built, once a solve.
int IncrementalProblem::FindOld(ceres::ResidualBlockId block) {
  if (next_old_ < old_factors_.size() && old_factors_[next_old_].block == block) {
    return static_cast<int>(next_old_++);
  }
  if (!old_index_built_) {
    old_blocks_.clear();
    for (const Factor& factor : old_factors_) {
      old_blocks_.push_back(factor.block);
    }
    old_index_.Build(old_blocks_);
    old_index_built_ = true;
  }
  const int old = old_index_.Find(block);
  if (old >= 0) {
    next_old_ = At(old) + 1;
  }
  return old;
}

bool IncrementalProblem::HasSameVariables(const Factor& factor, const ProblemView& view,
                                          const ResidualBlockView& residual) const {
  const RememberingFamily& family = *families_[At(factor.family)].family;
  if (family.residual_size() != residual.num_residuals || family.num_slots() != residual.num_slots) {
    return false;
  }
  for (int s = 0; s < residual.num_slots; ++s) {
    const int variable = variable_of_[At(view.SlotsOf(residual)[s])];
    if (variable < 0 || variables_[At(variable)].id != old_factor_variables_[At(factor.first_variable + s)]) {
      return false;
    }
  }
  return true;
}

// A residual block that stays in the graph: as it is if it is proved to be the same, else to be linearized anew.
void IncrementalProblem::Keep(const ProblemView& view, const ResidualBlockView& residual, Factor factor,
                              ProblemChanges* changes) {
  if (MustLinearize(factor, view, residual)) {
    factor.cost = residual.cost;
    families_[At(factor.family)].family->Place(factor.id.index, residual.cost);
    edit_.MeasurementChanged(factor.id);
    ++changes->num_replaced_factors;
  } else {
    ++changes->num_kept_factors;
  }
  const std::shared_ptr<const Loss>& loss = losses_.Get(residual.loss);
  if (loss.get() != factor.loss) {
    factor.loss = loss.get();
    edit_.SetLoss(factor.id, loss);
    ++changes->num_changed_losses;
  }
  const auto first = old_factor_variables_.begin() + factor.first_variable;
  factor.first_variable = static_cast<int>(factor_variables_.size());
  factor_variables_.insert(factor_variables_.end(), first, first + residual.num_slots);
  factors_.push_back(factor);
}

bool IncrementalProblem::MustLinearize(const Factor& factor, const ProblemView& view, const ResidualBlockView& residual) {
  if (factor.cost != residual.cost || forgotten_.count(residual.cost) != 0) {
    return true;
  }
  if (trust_ == Trust::kAddresses) {
    return false;
  }
  // Where the caller has set other values the solver linearizes anew anyway: nothing cached needs a proof.
  const int* slots = view.SlotsOf(residual);
  const bool revalued =
      std::any_of(slots, slots + residual.num_slots, [this](int b) { return revalued_[At(variable_of_[At(b)])] != 0; });
  return !revalued && !families_[At(factor.family)].family->Recognize(factor.id.index, residual.cost);
}

// What was not met again goes; what touches a variable that goes does so by itself.
void IncrementalProblem::RemoveRest(ProblemChanges* changes) {
  for (std::size_t i = 0; i < old_factors_.size(); ++i) {
    if (seen_[i] != 0) {
      continue;
    }
    const Factor& factor = old_factors_[i];
    RememberingFamily& family = *families_[At(factor.family)].family;
    const auto first = old_factor_variables_.begin() + factor.first_variable;
    if (std::none_of(first, first + family.num_slots(), [this](VariableId id) { return going_[At(id)] != 0; })) {
      edit_.RemoveFactor(factor.id);
    }
    family.Clear(factor.id.index);
    ++changes->num_removed_factors;
  }
}

void IncrementalProblem::AddFactors(const ProblemView& view, ProblemChanges* changes) {
  for (NewFactor& added : new_factors_) {
    const ResidualBlockView& residual = view.residuals[At(added.residual)];
    const int landmark_slot = families_[At(family_of_[At(added.residual)])].landmark_slot;
    added.landmark =
        landmark_slot < 0 ? static_cast<int>(variables_.size()) : variable_of_[At(view.SlotsOf(residual)[landmark_slot])];
  }
  const std::size_t first_new = factors_.size();
  for (std::size_t k = 0; k < new_factors_.size(); ++k) {
    factor_of_[At(new_factors_[k].residual)] = static_cast<int>(first_new + k);
  }
  factors_.resize(first_new + new_factors_.size());
  std::sort(new_factors_.begin(), new_factors_.end());
  for (const NewFactor& added : new_factors_) {
    AddFactor(view, added.residual, changes);
  }
}

void IncrementalProblem::AddFactor(const ProblemView& view, int r, ProblemChanges* changes) {
  const ResidualBlockView& residual = view.residuals[At(r)];
  const std::shared_ptr<const Loss>& loss = losses_.Get(residual.loss);
  Factor& factor = factors_[At(factor_of_[At(r)])];
  factor.block = residual.id;
  factor.cost = residual.cost;
  factor.loss = loss.get();
  factor.family = family_of_[At(r)];
  factor.first_variable = static_cast<int>(factor_variables_.size());
  for (int s = 0; s < residual.num_slots; ++s) {
    factor_variables_.push_back(variables_[At(variable_of_[At(view.SlotsOf(residual)[s])])].id);
  }
  const Family& family = families_[At(factor.family)];
  factor.id = edit_.Connect(family.id, factor_variables_.data() + factor.first_variable, loss);
  family.family->Place(factor.id.index, residual.cost);
  ++changes->num_added_factors;
}

}  // namespace inceres::internal
