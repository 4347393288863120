#include <cmath>
#include <string>

#include "inceres/graph/factor_graph.h"

namespace inceres {
namespace {

constexpr int kMaxLandmarkTangentSize = 4;

Status Invalid(std::string message) {
  return Status::Error(StatusCode::kInvalidArgument, std::move(message));
}

std::string VariableName(VariableId id) {
  return "variable " + std::to_string(id);
}

std::string FamilyName(FamilyId id, const FactorFamily& family) {
  return "family " + std::to_string(id) + " (" + family.Name() + ")";
}

// x·0 is NaN for a NaN and for an infinity; four sums hide the latency of the addition.
bool AllFinite(const double* values, std::size_t count) {
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
  return (sums[0] + sums[1]) + (sums[2] + sums[3]) == 0.0;
}

}  // namespace

Status FactorGraph::Validate() const {
  for (VariableId id = 0; id < num_variables(); ++id) {
    const VariableRecord& variable = variables_[Index(id)];
    const bool ordinary = variable.ambient_size > 0 && variable.manifold == nullptr && variable.offset >= 0 &&
                          (variable.role == Role::kFrame || variable.tangent_size <= kMaxLandmarkTangentSize);
    if (ordinary) {
      continue;
    }
    Status status = ValidateVariable(id);
    if (!status.ok()) {
      return status;
    }
  }
  Status status = AllFinite(state_.data(), state_.size()) ? Status::Ok() : ValidateValues();
  for (FamilyId id = 0; status.ok() && id < num_families(); ++id) {
    status = ValidateFamily(id);
  }
  return status;
}

Status FactorGraph::ValidateVariable(VariableId id) const {
  const VariableRecord& variable = variables_[Index(id)];
  if (variable.ambient_size <= 0) {
    return Invalid(VariableName(id) + " has ambient size " + std::to_string(variable.ambient_size) + "; it must be positive");
  }
  if (variable.offset < 0 && variable.borrowed == nullptr) {
    return Invalid(VariableName(id) + " is a borrowed constant with a null pointer to its values");
  }
  if (variable.offset < 0 && !AllFinite(variable.borrowed, Index(variable.ambient_size))) {
    return Invalid(VariableName(id) + " is a borrowed constant with a value that is not finite");
  }
  if (variable.manifold != nullptr && variable.manifold->AmbientSize() != variable.ambient_size) {
    return Invalid(VariableName(id) + " has " + std::to_string(variable.ambient_size) +
                   " values but its manifold has ambient size " + std::to_string(variable.manifold->AmbientSize()));
  }
  if (variable.tangent_size < 0 || variable.tangent_size > variable.ambient_size) {
    return Invalid(VariableName(id) + " has tangent size " + std::to_string(variable.tangent_size) +
                   "; it must lie between 0 and its ambient size " + std::to_string(variable.ambient_size));
  }
  if (variable.role == Role::kLandmark && !IsConstant(id) && variable.tangent_size > kMaxLandmarkTangentSize) {
    return Invalid(VariableName(id) + " is a landmark of tangent size " + std::to_string(variable.tangent_size) +
                   "; landmarks have at most " + std::to_string(kMaxLandmarkTangentSize) + ": make it a frame");
  }
  return Status::Ok();
}

Status FactorGraph::ValidateValues() const {
  for (VariableId id = 0; id < num_variables(); ++id) {
    const VariableRecord& variable = variables_[Index(id)];
    for (int k = 0; variable.offset >= 0 && k < variable.ambient_size; ++k) {
      const double value = state_[static_cast<std::size_t>(variable.offset + k)];
      if (!std::isfinite(value)) {
        return Invalid("value " + std::to_string(k) + " of " + VariableName(id) + " is " + std::to_string(value));
      }
    }
  }
  return Status::Ok();
}

Status FactorGraph::ValidateFamily(FamilyId id) const {
  const FamilyRecord& record = families_[Index(id)];
  const FactorFamily& family = *record.family;
  if (family.residual_size() <= 0) {
    return Invalid(FamilyName(id, family) + " has residual size " + std::to_string(family.residual_size()) +
                   "; it must be positive");
  }
  if (family.size() != record.num_factors) {
    return Invalid(FamilyName(id, family) + " holds " + std::to_string(family.size()) + " measurements but " +
                   std::to_string(record.num_factors) + " factors are connected");
  }
  for (int factor = 0; factor < record.num_factors; ++factor) {
    const FactorFault fault = FindFault(record, factor);
    if (fault.fault != Fault::kNone) {
      return DescribeFault(id, factor, fault);
    }
  }
  return Status::Ok();
}

FactorGraph::FactorFault FactorGraph::FindFault(const FamilyRecord& record, int factor) const {
  const FactorFamily& family = *record.family;
  const int num_slots = family.num_slots();
  const VariableId* ids = record.variables.data() + Index(factor) * Index(num_slots);
  int num_landmarks = 0;
  for (int s = 0; s < num_slots; ++s) {
    if (ids[s] < 0 || ids[s] >= num_variables()) {
      return {Fault::kDanglingId, s};
    }
    for (int other = 0; other < s; ++other) {
      if (ids[other] == ids[s]) {
        return {Fault::kRepeated, s};
      }
    }
    const VariableRecord& variable = variables_[Index(ids[s])];
    if (variable.ambient_size != family.slot(s).ambient_size) {
      return {Fault::kAmbientSize, s};
    }
    if (variable.constant || variable.tangent_size == 0) {
      continue;
    }
    if (variable.tangent_size != family.slot(s).tangent_size) {
      return {Fault::kTangentSize, s};
    }
    if (variable.role == Role::kLandmark && ++num_landmarks > 1) {
      return {Fault::kTwoLandmarks, s};
    }
  }
  return {};
}

Status FactorGraph::DescribeFault(FamilyId id, int factor, FactorFault fault) const {
  const FactorFamily::Slot& slot = family(id).slot(fault.slot);
  const VariableId variable = Variables(id, factor)[fault.slot];
  const std::string where = DescribeFactor(id, factor) + ": slot " + std::to_string(fault.slot);
  switch (fault.fault) {
    case Fault::kDanglingId:
      return Invalid(where + " names variable " + std::to_string(variable) + ", but the graph has " +
                     std::to_string(num_variables()) + " variables");
    case Fault::kAmbientSize:
      return Invalid(where + " has ambient size " + std::to_string(slot.ambient_size) + " but " + VariableName(variable) +
                     " has " + std::to_string(AmbientSize(variable)) + " values");
    case Fault::kTangentSize:
      return Invalid(where + " has tangent size " + std::to_string(slot.tangent_size) + " but " + VariableName(variable) +
                     " has " + std::to_string(TangentSize(variable)) + "; is the manifold the family expects set?");
    case Fault::kRepeated:
      return Invalid(where + " repeats " + VariableName(variable));
    case Fault::kTwoLandmarks:
      return Invalid(where + " is a second landmark (" + VariableName(variable) +
                     "); a factor touches at most one that is not constant: make the others frames");
    case Fault::kNone:
      break;
  }
  return Status::Ok();
}

std::string FactorGraph::DescribeFactor(FamilyId id, int factor) const {
  const int num_slots = family(id).num_slots();
  const VariableId* ids = Variables(id, factor);
  std::string text = "factor " + std::to_string(factor) + " of " + family(id).Name() + " (variables ";
  for (int s = 0; s < num_slots; ++s) {
    text += (s == 0 ? "" : ", ") + std::to_string(ids[s]);
  }
  return text + ")";
}

}  // namespace inceres
