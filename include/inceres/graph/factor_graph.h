#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/graph/factor_family.h"
#include "inceres/graph/loss.h"
#include "inceres/graph/manifold.h"
#include "inceres/status.h"

namespace inceres {

using VariableId = std::int32_t;
using FamilyId = std::int32_t;

/// What the solver does with a variable: landmarks (tangent size 1 to 4, at most one a factor) are eliminated first, one small
/// block each; frames (poses, velocities, calibrations, …) stay in the reduced system.
enum class Role : std::uint8_t { kFrame, kLandmark };

/// The problem  min_x ½ Σ_j ρ_j(‖f_j(x)‖²): variables on manifolds, factors grouped in families, losses, constants.
///
/// The graph owns the values of its variables (one contiguous *state*) and the connections of its factors. It checks nothing
/// while it is built; Validate(), which every solve calls first, names what is wrong. Ids are dense: 0, 1, 2, … in order of
/// addition.
///
/// Threads: one writer; concurrent reads are fine. Two graphs share nothing.
/// Source: algorithms.md section 1; Dellaert & Kaess, "Factor Graphs for Robot Perception", 2017.
class INCERES_EXPORT FactorGraph {
 public:
  /// Adds a variable with ambient_size values, which are copied (they must not lie in this graph's own state). A null manifold
  /// means Euclidean. Cost: no allocation beyond the growth of two vectors.
  VariableId AddVariable(const double* values, int ambient_size, Role role, std::shared_ptr<const Manifold> manifold = nullptr);

  /// Adds a constant whose values are *borrowed*: read in place at each evaluation, never written. `values` must outlive the
  /// graph's last solve. Its tangent size is 0 and it stays constant whatever SetConstant says.
  VariableId AddBorrowedConstant(const double* values, int ambient_size);

  /// Adds a family; its factors are connected with Connect, in the family's order.
  FamilyId AddFamily(std::shared_ptr<const FactorFamily> family);

  /// Connects the family's next factor to one variable per slot, with a loss (null: ½‖f‖²). Returns the factor's index in the
  /// family. `variables` has family.num_slots() entries. Cost: no allocation beyond the growth of a vector; losses cost nothing
  /// while no factor of the family has one.
  int Connect(FamilyId family, const VariableId* variables, std::shared_ptr<const Loss> loss = nullptr);

  /// Adds the measurement to a built-in family and connects it: graph.AddFactor(id, family, measurement, {camera, point}, loss).
  template <typename Family>
  int AddFactor(FamilyId id, Family& family, const typename Family::Measurement& measurement,
                const std::vector<VariableId>& variables, std::shared_ptr<const Loss> loss = nullptr) {
    family.Add(measurement);
    return Connect(id, variables.data(), std::move(loss));
  }

  void SetConstant(VariableId id, bool constant) { variables_[Index(id)].constant = constant; }
  void SetRole(VariableId id, Role role) { variables_[Index(id)].role = role; }
  /// Overwrites the values of a variable the graph owns; borrowed values are their owner's to change, so those are left alone.
  void SetValues(VariableId id, const double* values);
  void Reserve(int num_variables, int num_values);

  int num_variables() const { return static_cast<int>(variables_.size()); }
  int num_families() const { return static_cast<int>(families_.size()); }
  int num_factors() const;

  int AmbientSize(VariableId id) const { return variables_[Index(id)].ambient_size; }
  int TangentSize(VariableId id) const { return variables_[Index(id)].tangent_size; }
  Role role(VariableId id) const { return variables_[Index(id)].role; }
  /// True if held constant by SetConstant, borrowed, or of tangent size 0.
  bool IsConstant(VariableId id) const { return variables_[Index(id)].constant || variables_[Index(id)].tangent_size == 0; }
  const Manifold* manifold(VariableId id) const { return variables_[Index(id)].manifold.get(); }
  const double* Values(VariableId id) const { return ValuesIn(state_.data(), id); }

  const FactorFamily& family(FamilyId id) const { return *families_[Index(id)].family; }
  /// Number of *connected* factors of the family.
  int NumFactors(FamilyId id) const { return families_[Index(id)].num_factors; }
  /// The variables of factor i: num_slots entries.
  const VariableId* Variables(FamilyId id, int factor) const {
    const FamilyRecord& record = families_[Index(id)];
    return record.variables.data() + Index(factor) * Index(record.family->num_slots());
  }
  /// The factor's loss; null means ½‖f‖².
  const Loss* loss(FamilyId id, int factor) const {
    const FamilyRecord& record = families_[Index(id)];
    return record.losses.empty() ? nullptr : record.losses[Index(factor)].get();
  }
  /// True if any factor of the family has a loss.
  bool HasLosses(FamilyId id) const { return !families_[Index(id)].losses.empty(); }

  /// All owned values, one variable after the other in order of addition: what the solver copies, moves and writes back.
  const std::vector<double>& state() const { return state_; }
  std::vector<double>& mutable_state() { return state_; }
  /// Offset of the variable's values in the state, or -1 if they are borrowed.
  std::int64_t StateOffset(VariableId id) const { return variables_[Index(id)].offset; }
  /// The values of a variable in a given state vector (in borrowed memory for a borrowed constant).
  const double* ValuesIn(const double* state, VariableId id) const {
    const VariableRecord& variable = variables_[Index(id)];
    return variable.offset < 0 ? variable.borrowed : state + variable.offset;
  }

  /// Everything that makes the graph unsolvable, first culprit named: ids out of range, sizes that do not match a slot (of a
  /// constant only the ambient size counts) or the manifold, a variable twice in a factor, two variable landmarks in a factor, a
  /// variable landmark of tangent size above 4, values that are null or not finite, a family that holds more or fewer
  /// measurements than were connected. Cost: one pass over factors and values; allocates for the message only.
  Status Validate() const;

  /// "factor 7 of BAL reprojection (variables 3, 112)": for messages.
  std::string DescribeFactor(FamilyId id, int factor) const;

 private:
  struct VariableRecord {
    std::int64_t offset = 0;  // into state_, or -1
    const double* borrowed = nullptr;
    std::shared_ptr<const Manifold> manifold;
    int ambient_size = 0;
    int tangent_size = 0;
    Role role = Role::kFrame;
    bool constant = false;
  };
  struct FamilyRecord {
    std::shared_ptr<const FactorFamily> family;
    std::vector<VariableId> variables;                // factor-major, num_slots each
    std::vector<std::shared_ptr<const Loss>> losses;  // empty while no factor has one, else one a factor
    int num_factors = 0;
  };
  enum class Fault : std::uint8_t { kNone, kDanglingId, kAmbientSize, kTangentSize, kRepeated, kTwoLandmarks };
  struct FactorFault {
    Fault fault = Fault::kNone;
    int slot = 0;  // the slot at fault; for a pair the later one
  };

  static std::size_t Index(std::int32_t id) { return static_cast<std::size_t>(id); }
  FactorFault FindFault(const FamilyRecord& record, int factor) const;
  Status ValidateVariable(VariableId id) const;
  Status ValidateValues() const;
  Status ValidateFamily(FamilyId id) const;
  Status DescribeFault(FamilyId id, int factor, FactorFault fault) const;

  std::vector<VariableRecord> variables_;
  std::vector<FamilyRecord> families_;
  std::vector<double> state_;
};

}  // namespace inceres
