#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "base/formatted.h"
#include "inceres/problem/factor_graph.h"
#include "problem/slot_space.h"

namespace inceres::internal {

inline Status Invalid(std::string message) {
  return Status::Error(StatusCode::kInvalidArgument, std::move(message));
}

/// A number in a message.
inline std::string NumberText(double value) {
  return Formatted("%.9g", value);
}

inline std::string VariableName(VariableId id) {
  return "variable " + std::to_string(id);
}

inline std::string FamilyName(FamilyId id, const FactorFamily& family) {
  return "family " + std::to_string(id) + " (" + family.Name() + ")";
}

inline std::string NoFamily(const char* call, const FactorGraph& graph, FamilyId id) {
  return std::string(call) + ": there is no family " + std::to_string(id) + "; the graph has " +
         std::to_string(graph.num_families());
}

/// Whether the graph has the family `given` under this id.
Status CheckHandle(const char* call, const FactorGraph& graph, FamilyId id,
                   const FactorFamily* given);

bool AllFinite(const double* values, std::size_t count);
/// Names the first value that is not finite: `call` "value 2 of " `of` "variable 3 is nan". Both
/// bring their own punctuation, "SetValues: " and "the pin of ", or are empty.
Status CheckFinite(const char* call, const char* of, VariableId id, const double* values, int size);

// Of many the compiler compares several at a time, without an early end: for the factors that touch
// hundreds of variables.
inline bool IsAmong(VariableId id, const VariableId* ids, int count) {
  if (count < 8) {
    int k = 0;
    while (k < count && ids[k] != id) {
      ++k;
    }
    return k < count;
  }
  int found = 0;
  for (int k = 0; k < count; ++k) {
    found |= ids[k] == id ? 1 : 0;
  }
  return found != 0;
}

enum class Fault : std::uint8_t {
  kNone,
  kDanglingId,
  kRemoved,
  kGoing,
  kAmbientSize,
  kTangentSize,
  kManifold,
  kRepeated,
  kTwoLandmarks
};

struct FactorFault {
  Fault fault = Fault::kNone;
  int slot = 0;  // the slot at fault; for a pair the later one
};

/// A variable as a factor finds it: now, or after an edit. No record if there is a fault.
struct Sight {
  const VariableRecord* record = nullptr;
  bool constant = false;
  Fault fault = Fault::kNone;
};

inline Sight See(const VariableTable& variables, VariableId id) {
  if (id < 0 || id >= variables.size()) {
    return {nullptr, false, Fault::kDanglingId};
  }
  const VariableRecord& variable = variables[id];
  return {&variable, variable.constant, variable.removed ? Fault::kRemoved : Fault::kNone};
}

/// The manifolds that a family has accepted at its slots, so that variables which share one are
/// asked about once.
class AcceptedManifolds {
 public:
  bool Accepts(const FactorFamily& family, int s, const Manifold& manifold) {
    const bool is_kept = s < kKeptSlots;
    if (is_kept && accepted_[s] == &manifold) {
      return true;
    }
    if (!MovesIn(family.Space(s), manifold)) {
      return false;
    }
    if (is_kept) {
      accepted_[s] = &manifold;
    }
    return true;
  }

 private:
  static constexpr int kKeptSlots = 8;
  const Manifold* accepted_[kKeptSlots] = {};
};

/// Whether the factor moves what it finds.
inline bool Moves(const Sight& sight) {
  return !sight.constant && sight.record->tangent_size != 0;
}

/// The rules of a slot, whatever the factor's others are. accepts(manifold): the family's.
template <typename AcceptsManifold>
Fault FaultAtSlot(const FactorFamily::Slot& slot, const Sight& sight,
                  const AcceptsManifold& accepts) {
  if (sight.fault != Fault::kNone) {
    return sight.fault;
  }
  const VariableRecord& variable = *sight.record;
  if (variable.ambient_size != slot.ambient_size) {
    return Fault::kAmbientSize;
  }
  if (!Moves(sight)) {
    return Fault::kNone;
  }
  if (variable.tangent_size != slot.tangent_size) {
    return Fault::kTangentSize;
  }
  const bool is_right = variable.manifold == nullptr || accepts(*variable.manifold);
  return is_right ? Fault::kNone : Fault::kManifold;
}

/// Up to so many slots a factor's variables are compared each with each, beyond it sorted.
constexpr int kManySlots = 256;

/// The first slot whose variable is that of a slot before it; `count` if all differ. Allocates, and
/// takes count · log(count).
int FirstRepeated(const VariableId* ids, int count);

/// The rules of a factor, whether it is there already or comes with an edit: see(id) is the
/// variable as the factor finds it. `accepted` is for factors of this family.
template <typename SeeVariable>
FactorFault FindFault(const FactorFamily& family, const VariableId* ids, const SeeVariable& see,
                      AcceptedManifolds* accepted) {
  const bool has_many = family.num_slots() > kManySlots;
  const int first_repeated = has_many ? FirstRepeated(ids, family.num_slots()) : -1;
  int num_landmarks = 0;
  for (int s = 0; s < family.num_slots(); ++s) {
    const Sight sight = see(ids[s]);
    const bool is_repeated = has_many ? s == first_repeated : IsAmong(ids[s], ids, s);
    if (sight.fault == Fault::kNone && is_repeated) {
      return {Fault::kRepeated, s};
    }
    const Fault fault = FaultAtSlot(family.slot(s), sight, [&](const Manifold& manifold) {
      return accepted->Accepts(family, s, manifold);
    });
    if (fault != Fault::kNone) {
      return {fault, s};
    }
    if (Moves(sight) && sight.record->role == Role::kLandmark && ++num_landmarks > 1) {
      return {Fault::kTwoLandmarks, s};
    }
  }
  return {};
}

/// The rules of a family, whatever its factors are.
Status ValidateSizes(FamilyId id, const FactorFamily& family);
/// The rules of a variable.
Status ValidateVariable(VariableId id, const VariableRecord& variable, bool constant);
/// The fault in words. `culprit` is the variable's record, if it has one.
Status DescribeFault(const FactorGraph& graph, FactorId id, const VariableId* ids,
                     FactorFault fault, const VariableRecord* culprit);

}  // namespace inceres::internal
