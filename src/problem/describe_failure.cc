#include <algorithm>
#include <cstdio>
#include <string>

#include "inceres/problem/ambient_family.h"
#include "inceres/problem/factor_graph.h"
#include "problem/find_fault.h"

// Messages for factors that cannot be evaluated: which factor, why, which number it was, what the
// user knows the factor and its variables by, and where it was evaluated. Made after a failure
// only, so cost does not matter, but size does: factors may touch hundreds of variables of hundreds
// of values.

namespace inceres {
namespace {

constexpr int kMaxValues = 6;
constexpr int kMaxVariables = 8;

// "residual 1 is nan", "entry (0, 2) of the Jacobian of variable 5 was not written"; empty if it is
// not known.
std::string Culprit(const FactorFamily& family, const EvaluationFailure& failure,
                    const std::string& variable) {
  if (failure.entry < 0) {
    return "";
  }
  // A number that no formula is likely to give: memory was marked with it, and nobody wrote there.
  const std::string what =
      failure.value == kUnwritten ? "was not written" : "is " + internal::NumberText(failure.value);
  if (failure.slot < 0) {
    return "residual " + std::to_string(failure.entry) + " " + what;
  }
  // Entries count through the ambient Jacobian, row by row, whatever the tangent map.
  const int columns = std::max(1, family.slot(failure.slot).ambient_size);
  return "entry (" + std::to_string(failure.entry / columns) + ", " +
         std::to_string(failure.entry % columns) + ") of the Jacobian by " + variable + " " + what;
}

std::string FirstValues(const double* values, int size) {
  std::string text = "(";
  for (int k = 0; k < std::min(size, kMaxValues); ++k) {
    text += (k == 0 ? "" : ", ") + internal::NumberText(values[k]);
  }
  return text + (size > kMaxValues ? ", …)" : ")");
}

}  // namespace

// The same text for every object that is known by its address.
std::string internal::DescribeObject(const char* kind, const void* object) {
  char address[32];
  std::snprintf(address, sizeof(address), "%p", object);
  return std::string(kind) + " " + address;
}

std::string FactorGraph::DescribeFailure(FamilyId id, const EvaluationFailure& failure,
                                         const double* const* parameters) const {
  const FactorFamily& family = this->family(id);
  const VariableId* ids = Variables(id, failure.factor);
  // In a user's terms, if he has told any (SetVariableNames).
  const auto name = [this, ids](int slot) {
    return variable_name_ != nullptr ? variable_name_(ids[slot])
                                     : internal::VariableName(ids[slot]);
  };
  const std::string known_as = family.Describe(failure.factor);
  // What failed comes first, then where: messages are read from the left and may be cut.
  const std::string culprit = Culprit(family, failure, failure.slot < 0 ? "" : name(failure.slot));
  std::string text = DescribeFactor(id, failure.factor) + ": " + failure.reason;
  text += culprit.empty() ? "" : ": " + culprit;
  text += known_as.empty() ? "" : "; " + known_as;
  // At the point of the failure, which is not that of the graph if a step was being tried.
  for (int s = 0; s < std::min(family.num_slots(), kMaxVariables); ++s) {
    text += (s == 0 ? "; at " : ", ") + name(s) + " = " +
            FirstValues(parameters[s], family.slot(s).ambient_size);
  }
  return text + (family.num_slots() > kMaxVariables ? ", …" : "");
}

}  // namespace inceres
