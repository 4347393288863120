#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include "problem/edited_graph.h"
#include "problem/find_fault.h"

namespace inceres {

using internal::AllFinite;
using internal::FactorFault;
using internal::FamilyName;
using internal::FamilyRecord;
using internal::Fault;
using internal::Invalid;
using internal::VariableName;
using internal::VariableRecord;
using internal::VariableTable;

// The rules of a graph that can be solved, and their messages. Validate runs before every solve, so
// the common case is fast: variables that are obviously in order are passed over, all values are
// looked at in one pass over the state, and factors that touch what the one before them touches are
// not looked at again. Only when something is wrong does it search for the culprit, in the order of
// ids. The rules of one factor are in find_fault.h, shared with edits.

namespace {

// Landmarks are eliminated in blocks of at most this size.
constexpr int kMaxLandmarkTangentSize = 4;

// With the ids of its variables, by which the caller can look it up.
std::string Describe(int factor, const FactorFamily& family, const VariableId* ids) {
  std::string text = "factor " + std::to_string(factor) + " of " + family.Name() + " (variables ";
  for (int s = 0; s < family.num_slots(); ++s) {
    text += (s == 0 ? "" : ", ") + std::to_string(ids[s]);
  }
  return text + ")";
}

}  // namespace

// A handle knows its family; the graph must have it under the handle's id, or measurement and
// connection would go to two different families.
Status internal::CheckHandle(const char* call, const FactorGraph& graph, FamilyId id,
                             const FactorFamily* given) {
  if (id < 0 || id >= graph.num_families()) {
    return Invalid(internal::NoFamily(call, graph, id));
  }
  if (given != &graph.family(id)) {
    return Invalid(std::string(call) + ": " + FamilyName(id, graph.family(id)) +
                   " is not the family of the handle (" +
                   (given == nullptr ? "which has none" : given->Name()) + ")");
  }
  return Status::Ok();
}

// x·0 is NaN for a NaN and for an infinity; four sums hide the latency of the addition.
bool internal::AllFinite(const double* values, std::size_t count) {
  double sums[4] = {0.0, 0.0, 0.0, 0.0};
  std::size_t k = 0;
  for (; k + 4 <= count; k += 4) {
    for (std::size_t lane = 0; lane < 4; ++lane) {
      sums[lane] += values[k + lane] * 0.0;
    }
  }
  for (; k < count; ++k) {
    sums[0] += values[k] * 0.0;
  }
  // Zero plus zero of either sign is zero; a NaN in any lane makes the comparison false.
  return (sums[0] + sums[1]) + (sums[2] + sums[3]) == 0.0;
}

// Slow and exact.
Status internal::CheckFinite(const char* call, const char* of, VariableId id, const double* values,
                             int size) {
  for (int k = 0; k < size; ++k) {
    if (!std::isfinite(values[k])) {
      return Invalid(std::string(call) + "value " + std::to_string(k) + " of " + of +
                     VariableName(id) + " is " + std::to_string(values[k]));
    }
  }
  return Status::Ok();
}

// A factor without variables has no entry in the tables by which factors are evaluated.
Status internal::ValidateSizes(FamilyId id, const FactorFamily& family) {
  if (family.residual_size() <= 0) {
    return Invalid(FamilyName(id, family) + " has residual size " +
                   std::to_string(family.residual_size()) + "; it must be positive");
  }
  return family.num_slots() > 0
             ? Status::Ok()
             : Invalid(FamilyName(id, family) + " has no slots; a factor touches a variable");
}

// Slots in the order of their variables, and of each variable in their own: neighbors tell.
int internal::FirstRepeated(const VariableId* ids, int count) {
  std::vector<int> slots(IndexOf(count));
  std::iota(slots.begin(), slots.end(), 0);
  std::sort(slots.begin(), slots.end(),
            [ids](int a, int b) { return ids[a] != ids[b] ? ids[a] < ids[b] : a < b; });
  int first = count;
  for (std::size_t k = 1; k < slots.size(); ++k) {
    if (ids[slots[k]] == ids[slots[k - 1]]) {
      first = std::min(first, slots[k]);
    }
  }
  return first;
}

// The order matters: sizes come before what is read by them.
Status internal::ValidateVariable(VariableId id, const VariableRecord& variable, bool constant) {
  if (variable.ambient_size <= 0) {
    return Invalid(VariableName(id) + " has ambient size " + std::to_string(variable.ambient_size) +
                   "; it must be positive");
  }
  if (variable.offset < 0 && variable.borrowed == nullptr) {
    return Invalid(VariableName(id) + " is a borrowed constant with a null pointer to its values");
  }
  // Owned values are looked at all at once; borrowed ones lie elsewhere.
  if (variable.offset < 0 &&
      !AllFinite(variable.borrowed, static_cast<std::size_t>(variable.ambient_size))) {
    return Invalid(VariableName(id) + " is a borrowed constant with a value that is not finite");
  }
  if (variable.manifold != nullptr && variable.manifold->AmbientSize() != variable.ambient_size) {
    return Invalid(VariableName(id) + " has " + std::to_string(variable.ambient_size) +
                   " values but its manifold has ambient size " +
                   std::to_string(variable.manifold->AmbientSize()));
  }
  // By the manifold, which may be a user's.
  if (variable.tangent_size < 0 || variable.tangent_size > variable.ambient_size) {
    return Invalid(VariableName(id) + " has tangent size " + std::to_string(variable.tangent_size) +
                   "; it must lie between 0 and its ambient size " +
                   std::to_string(variable.ambient_size));
  }
  // The entries of a plus-Jacobian are counted by an int.
  const std::int64_t num_entries = std::int64_t{variable.ambient_size} * variable.tangent_size;
  if (variable.manifold != nullptr && num_entries > std::numeric_limits<int>::max()) {
    return Invalid(VariableName(id) + " has a plus-Jacobian of " +
                   std::to_string(variable.ambient_size) + " x " +
                   std::to_string(variable.tangent_size) + " entries, more than 2^31 - 1");
  }
  if (variable.group < 0) {
    return Invalid(VariableName(id) + " is in the elimination group " +
                   std::to_string(variable.group) + "; groups are 0 or above");
  }
  // A constant landmark is not eliminated, so its size does not matter.
  if (variable.role == Role::kLandmark && !constant &&
      variable.tangent_size > kMaxLandmarkTangentSize) {
    return Invalid(VariableName(id) + " is a landmark of tangent size " +
                   std::to_string(variable.tangent_size) + "; landmarks have at most " +
                   std::to_string(kMaxLandmarkTangentSize) + ": make it a frame");
  }
  return Status::Ok();
}

namespace {

// After the fast pass has found that there is something.
Status ValidateValues(const VariableTable& variables) {
  Status status;
  for (VariableId id = 0; status.ok() && id < variables.size(); ++id) {
    const VariableRecord& variable = variables[id];
    if (!variable.removed && variable.offset >= 0) {
      status = internal::CheckFinite("", "", id, variables.state().data() + variable.offset,
                                     variable.ambient_size);
    }
  }
  return status;
}

Status ValidateVariables(const VariableTable& variables) {
  for (VariableId id = 0; id < variables.size(); ++id) {
    const VariableRecord& variable = variables[id];
    // Nothing can be wrong with such a variable but its values.
    const bool ordinary =
        variable.ambient_size > 0 && variable.manifold == nullptr && variable.offset >= 0 &&
        variable.group >= 0 &&
        (variable.role == Role::kFrame || variable.tangent_size <= kMaxLandmarkTangentSize);
    if (ordinary || variable.removed) {
      continue;
    }
    Status status =
        internal::ValidateVariable(id, variable, variable.constant || variable.tangent_size == 0);
    if (!status.ok()) {
      return status;
    }
  }
  // The room of removed variables holds zeros, so the pass runs over everything.
  return AllFinite(variables.state().data(), variables.state().size()) ? Status::Ok()
                                                                       : ValidateValues(variables);
}

// Of the few that are pinned. The values are of the variable's size, as PinLinearization took them.
Status ValidatePins(const VariableTable& variables) {
  Status status;
  for (auto pin = variables.pins().begin(); status.ok() && pin != variables.pins().end(); ++pin) {
    const auto& [id, values] = *pin;
    status = internal::CheckFinite("", "the pin of ", id, values.data(),
                                   static_cast<int>(values.size()));
  }
  return status;
}

// As in Ceres: a variable starts anywhere, for it is projected; a constant cannot be.
Status ValidateBounds(VariableId id, const VariableBounds& bounds, const double* values,
                      bool constant) {
  // What the start must satisfy; what a solve does with bounds is the solver's affair.
  for (std::size_t k = 0; k < bounds.lower.size(); ++k) {
    const double lower = bounds.lower[k];
    const double upper = bounds.upper[k];
    const auto entry = [&] { return "value " + std::to_string(k) + " of " + VariableName(id); };
    if (std::isnan(lower) || std::isnan(upper)) {
      return Invalid(entry() + " has a bound that is not a number");
    }
    // Of a free variable, equal bounds are refused too: nothing could move between them.
    if (!constant && !(lower < upper)) {
      return Invalid(entry() + " has the lower bound " + std::to_string(lower) +
                     ", which is not below its upper bound " + std::to_string(upper));
    }
    if (constant && (values[k] < lower || values[k] > upper)) {
      return Invalid(entry() + " is constant at " + std::to_string(values[k]) +
                     ", outside its bounds " + std::to_string(lower) + " and " +
                     std::to_string(upper));
    }
  }
  return Status::Ok();
}

// Whether factors are in order, at a glance: of a slot that has the variable it had in the factor
// before only that is asked. "No" is for FindFault to say what it is, or that it is nothing.
class FactorGlance {
 public:
  FactorGlance(const FactorFamily& family, const VariableTable& variables)
      : family_(family),
        num_slots_(family.num_slots()),
        num_variables_(variables.size()),
        records_(variables.size() > 0 ? &variables[0] : nullptr) {
    for (int s = 0; s < num_slots_ && num_slots_ <= kMostSlots; ++s) {
      slots_[s] = family.slot(s);
      takes_any_manifold_[s] = family.Space(s) == SlotSpace::kAny;
    }
  }

  /// `before` was in order at the last glance, or is null.
  bool IsInOrder(const VariableId* ids, const VariableId* before) {
    if (num_slots_ > kMostSlots) {
      return false;
    }
    if (before == nullptr) {
      num_landmarks_ = 0;
      std::fill_n(is_landmark_, num_slots_, false);
    }
    for (int s = 0; s < num_slots_; ++s) {
      if ((before == nullptr || ids[s] != before[s]) && !IsSlotInOrder(ids, s)) {
        return false;
      }
    }
    return num_landmarks_ <= 1;
  }

 private:
  static constexpr int kMostSlots = internal::kManySlots;

  bool IsSlotInOrder(const VariableId* ids, int s) {
    const VariableId id = ids[s];
    if (id < 0 || id >= num_variables_ || IsAmongOthers(ids, s)) {
      return false;
    }
    const VariableRecord& variable = records_[id];
    const internal::Sight sight = {&variable, variable.constant,
                                   variable.removed ? Fault::kRemoved : Fault::kNone};
    const bool is_landmark = variable.role == Role::kLandmark && internal::Moves(sight);
    num_landmarks_ += (is_landmark ? 1 : 0) - (is_landmark_[s] ? 1 : 0);
    is_landmark_[s] = is_landmark;
    return internal::FaultAtSlot(slots_[s], sight, [this, s](const Manifold& manifold) {
             return takes_any_manifold_[s] || accepted_.Accepts(family_, s, manifold);
           }) == Fault::kNone;
  }

  bool IsAmongOthers(const VariableId* ids, int s) const {
    return internal::IsAmong(ids[s], ids, s) ||
           internal::IsAmong(ids[s], ids + s + 1, num_slots_ - s - 1);
  }

  const FactorFamily& family_;
  const int num_slots_;
  const int num_variables_;
  const VariableRecord* const records_;
  FactorFamily::Slot slots_[kMostSlots];
  bool takes_any_manifold_[kMostSlots];
  internal::AcceptedManifolds accepted_;
  bool is_landmark_[kMostSlots];  // that moves
  int num_landmarks_ = 0;         // of these slots
};

// What a family is before its factors are looked at. `edited`: an edit was checked.
Status CheckCounts(const FamilyRecord& record, FamilyId id, bool edited) {
  const FactorFamily& family = *record.family;
  const Status sizes = internal::ValidateSizes(id, family);
  if (!sizes.ok()) {
    return sizes;
  }
  // More measurements than factors are a mistake while a graph is built. After an edit was checked,
  // it may be one that was refused and had placed its measurement already.
  if (family.size() < record.num_factors || (family.size() > record.num_factors && !edited)) {
    return Invalid(FamilyName(id, family) + " holds " + std::to_string(family.size()) +
                   " measurements but " + std::to_string(record.num_factors) +
                   " factors are connected");
  }
  return Status::Ok();
}

// Whether all factors touch the same variables, as in curve fitting: one stands for all, and the
// comparison of an array with itself, one factor on, is fast.
bool AreAlike(const FamilyRecord& record) {
  const VariableId* ids = record.variables.data();
  return record.places.empty() && record.num_factors > 0 &&
         std::equal(ids + record.family->num_slots(), ids + record.variables.size(), ids);
}

Status ValidateFamily(const FactorGraph& graph, const VariableTable& variables,
                      const FamilyRecord& record, FamilyId id, bool edited) {
  const Status counts = CheckCounts(record, id, edited);
  if (!counts.ok()) {
    return counts;
  }
  const FactorFamily& family = *record.family;
  const int num_slots = family.num_slots();
  const std::vector<internal::PlaceState>& places = record.places;
  const bool all_live = places.empty();
  const VariableId* ids = record.variables.data();
  const int num_different = AreAlike(record) ? 1 : record.num_factors;
  internal::AcceptedManifolds accepted;
  FactorGlance glance(family, variables);
  const VariableId* before = nullptr;  // the last one that was glanced at and in order
  for (int factor = 0; factor < num_different; ++factor, ids += num_slots) {
    if (!all_live && places[internal::IndexOf(factor)] == internal::PlaceState::kFree) {
      continue;
    }
    if (glance.IsInOrder(ids, before)) {
      before = ids;
      continue;
    }
    before = nullptr;
    const FactorFault fault = internal::FindFault(
        family, ids,
        [&variables](VariableId variable) { return internal::See(variables, variable); },
        &accepted);
    // The culprit's record is only there to tell its sizes.
    if (fault.fault != Fault::kNone) {
      const VariableId culprit = ids[fault.slot];
      const bool known = culprit >= 0 && culprit < variables.size();
      return internal::DescribeFault(graph, {id, factor}, ids, fault,
                                     known ? &variables[culprit] : nullptr);
    }
  }
  return Status::Ok();
}

}  // namespace

// Shared with edits, whose variables may not be in the graph: the record is handed in.
Status internal::DescribeFault(const FactorGraph& graph, FactorId id, const VariableId* ids,
                               FactorFault fault, const VariableRecord* culprit) {
  const FactorFamily::Slot& slot = graph.family(id.family).slot(fault.slot);
  const VariableId variable = ids[fault.slot];
  // The factor with all its variables first, then the slot at fault.
  const std::string where =
      Describe(id.index, graph.family(id.family), ids) + ": slot " + std::to_string(fault.slot);
  switch (fault.fault) {
    case Fault::kDanglingId:
      return Invalid(where + " names variable " + std::to_string(variable) +
                     ", but the graph has " + std::to_string(graph.num_variables()) + " variables");
    case Fault::kRemoved:
      return Invalid(where + " names " + VariableName(variable) + ", which has been removed");
    case Fault::kGoing:
      return Invalid(where + " names " + VariableName(variable) + ", which the same edit removes");
    case Fault::kAmbientSize:
      return Invalid(where + " has ambient size " + std::to_string(slot.ambient_size) + " but " +
                     VariableName(variable) + " has " + std::to_string(culprit->ambient_size) +
                     " values");
    case Fault::kTangentSize:
      return Invalid(where + " has tangent size " + std::to_string(slot.tangent_size) + " but " +
                     VariableName(variable) + " has " + std::to_string(culprit->tangent_size) +
                     "; is the manifold the family expects set?");
    case Fault::kManifold:
      return Invalid(where + " takes " + NameOf(graph.family(id.family).Space(fault.slot)) +
                     ", but " + VariableName(variable) +
                     " is on a manifold that moves it otherwise");
    case Fault::kRepeated:
      return Invalid(where + " repeats " + VariableName(variable));
    case Fault::kTwoLandmarks:
      return Invalid(
          where + " is a second landmark (" + VariableName(variable) +
          "); a factor touches at most one that is not constant: make the others frames");
    case Fault::kNone:
      break;
  }
  return Status::Ok();
}

Status FactorGraph::Validate() const {
  // A call that could not be carried out: the graph is not what its builder meant it to be.
  if (!misuse_.ok()) {
    return misuse_;
  }
  Status status = ValidateVariables(variables_);
  for (auto bounded = variables_.bounds().begin();
       status.ok() && bounded != variables_.bounds().end(); ++bounded) {
    const VariableId id = bounded->first;
    status = ValidateBounds(id, bounded->second, Values(id), IsConstant(id));
  }
  status = status.ok() ? ValidatePins(variables_) : status;
  for (FamilyId id = 0; status.ok() && id < num_families(); ++id) {
    status = ValidateFamily(*this, variables_, factors_[id], id, is_edited_);
  }
  return status;
}

std::string FactorGraph::DescribeFactor(FamilyId id, int factor) const {
  return Describe(factor, family(id), Variables(id, factor));
}

}  // namespace inceres
