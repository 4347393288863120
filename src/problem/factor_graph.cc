#include "inceres/problem/factor_graph.h"

#include <algorithm>
#include <string>
#include <utility>

#include "problem/edited_graph.h"
#include "problem/find_fault.h"

// How a graph is built up and read; what it is made of is in variable_table.cc and factor_table.cc.
//
// Building reports nothing. What can still be stored is stored, wrong or not, and Validate, which
// every solve calls, names the first culprit; what cannot be stored is remembered as misuse.

namespace inceres {

using internal::FamilyName;
using internal::Invalid;
using internal::VariableRecord;

namespace {

// The first few ids: a factor may have been given thousands.
std::string CountAndList(const std::vector<VariableId>& variables) {
  constexpr std::size_t kMaxListed = 8;
  std::string text =
      std::to_string(variables.size()) + (variables.size() == 1 ? " variable" : " variables");
  for (std::size_t i = 0; i < std::min(variables.size(), kMaxListed); ++i) {
    text += (i == 0 ? " (" : ", ") + std::to_string(variables[i]);
  }
  return text + (variables.empty() ? "" : variables.size() > kMaxListed ? ", …)" : ")");
}

// "2 slots (of 9, 3 values)".
std::string DescribeSlots(const FactorFamily& family) {
  std::string text =
      std::to_string(family.num_slots()) + (family.num_slots() == 1 ? " slot" : " slots");
  for (int s = 0; s < family.num_slots(); ++s) {
    text += (s == 0 ? " (of " : ", ") + std::to_string(family.slot(s).ambient_size);
  }
  return text + (family.num_slots() == 0 ? "" : " values)");
}

}  // namespace

VariableId FactorGraph::AddVariable(const double* values, int ambient_size, Role role,
                                    std::shared_ptr<const Manifold> manifold) {
  // Edits that were begun before are then refused.
  ++revision_;
  factors_.AddVariable();
  return variables_.Append(VariableRecord::Owned(ambient_size, role, std::move(manifold)), values);
}

VariableId FactorGraph::AddBorrowedConstant(const double* values, int ambient_size) {
  ++revision_;
  factors_.AddVariable();
  return variables_.Append(VariableRecord::Borrowed(values, ambient_size), nullptr);
}

FamilyId FactorGraph::AddFamily(std::shared_ptr<const FactorFamily> family) {
  if (family == nullptr) {
    Misused("AddFamily: the family is a null pointer");
    return -1;
  }
  ++revision_;
  return factors_.AddFamily(std::move(family));
}

// False, so that callers can return it.
// The first misuse is kept: later ones may follow from it.
bool FactorGraph::Misused(std::string message) {
  if (misuse_.ok()) {
    misuse_ = Invalid(std::move(message));
  }
  return false;
}

bool FactorGraph::HasFamily(const char* call, FamilyId id) {
  return factors_.Has(id) || Misused(internal::NoFamily(call, *this, id));
}

// Before AddFactor adds the measurement: a family must not hold more measurements than factors.
bool FactorGraph::CanAddFactor(FamilyId id, const FactorFamily* given,
                               const std::vector<VariableId>& variables) {
  Status handle = internal::CheckHandle("AddFactor", *this, id, given);
  if (!handle.ok()) {
    return Misused(std::move(handle.message));
  }
  return variables.size() == internal::IndexOf(given->num_slots()) ||
         Misused("AddFactor: a factor of " + FamilyName(id, *given) + " is given " +
                 CountAndList(variables) + " but has " + DescribeSlots(*given));
}

int FactorGraph::Connect(FamilyId family, const VariableId* variables,
                         std::shared_ptr<const Loss> loss) {
  if (!HasFamily("Connect", family)) {
    return -1;
  }
  ++revision_;
  return factors_.Append(family, variables, std::move(loss));
}

// Takes the caller's vectors as they are when the family is empty. With factors there, or with
// lists to keep, it is the same as Connect one by one.
void FactorGraph::ConnectMany(FamilyId family, std::vector<VariableId> variables,
                              std::vector<std::shared_ptr<const Loss>> losses) {
  if (variables.empty() || !HasFamily("ConnectMany", family)) {
    return;
  }
  const internal::FamilyRecord& record = factors_[family];
  const std::size_t num_slots = internal::IndexOf(record.family->num_slots());
  // Without slots no number of variables fits.
  const std::size_t count = num_slots == 0 ? 0 : variables.size() / num_slots;
  if (count * num_slots != variables.size()) {
    Misused("ConnectMany: factors of " + FamilyName(family, *record.family) + " have " +
            DescribeSlots(*record.family) + ", and " + std::to_string(variables.size()) +
            " variables are not so many each");
    return;
  }
  if (!losses.empty() && losses.size() != count) {
    Misused("ConnectMany: " + std::to_string(count) + " factors of " +
            FamilyName(family, *record.family) + " are given " + std::to_string(losses.size()) +
            " losses");
    return;
  }
  if (record.num_factors > 0 || factors_.lists().kept()) {
    for (std::size_t i = 0; i < count; ++i) {
      Connect(family, variables.data() + i * num_slots,
              losses.empty() ? nullptr : std::move(losses[i]));
    }
    return;
  }
  ++revision_;
  factors_.TakeOver(family, std::move(variables), std::move(losses));
}

}  // namespace inceres
