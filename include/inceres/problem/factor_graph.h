#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "inceres/status.h"

namespace inceres {

using VariableId = std::int32_t;
using FamilyId = std::int32_t;

/// Names a factor of a graph: its family and its place there. The place of a removed factor is given to a later one.
struct FactorId {
  FamilyId family = -1;
  std::int32_t index = -1;
};

/// Bounds on the values of a variable, one entry a value: lower ≤ x ≤ upper. ∓infinity, or ∓the largest double, means none.
struct VariableBounds {
  std::vector<double> lower;
  std::vector<double> upper;
};

class GraphEdit;
namespace internal {
class EditCheck;
class EditCommit;
}  // namespace internal

/// What the solver does with a variable: landmarks (tangent size 1 to 4, at most one a factor) are eliminated first, one small
/// block each; frames (poses, velocities, calibrations, …) stay in the reduced system.
enum class Role : std::uint8_t { kFrame, kLandmark };

/// The problem  min_x ½ Σ_j ρ_j(‖f_j(x)‖²): variables on manifolds, factors grouped in families, losses, constants.
///
/// The graph owns the values of its variables (one contiguous *state*) and the connections of its factors. It reports nothing
/// while it is built; Validate(), which every solve calls first, names what is wrong. A call that cannot be carried out at all
/// (no such family, fewer or more variables than a factor has slots) changes nothing but what Validate() says. Ids are dense: 0,
/// 1, 2, … in order of addition.
///
/// A graph that lives on is changed by transactions (GraphEdit, graph_edit.h), which are checked as a whole and can remove. Ids
/// then have gaps: what is removed leaves its id free, with its room in the state or its place in the family, for something later
/// of the same size or family. num_variables() and NumFactors() go on counting ids and places, free ones included.
///
/// Threads: one writer; concurrent reads are fine. Two graphs share nothing.
/// Source: Dellaert & Kaess, "Factor Graphs for Robot Perception", 2017.
class INCERES_EXPORT FactorGraph {
 public:
  /// Adds a variable with ambient_size values, which are copied (they must not lie in this graph's own state). A null manifold
  /// means Euclidean. Cost: no allocation beyond the growth of two vectors.
  VariableId AddVariable(const double* values, int ambient_size, Role role, std::shared_ptr<const Manifold> manifold = nullptr);

  /// Adds a constant whose values are *borrowed*: read in place at each evaluation, never written. `values` must outlive the
  /// graph's last solve. Its tangent size is 0 and it stays constant whatever SetConstant says.
  VariableId AddBorrowedConstant(const double* values, int ambient_size);

  /// Adds a family; its factors are connected with Connect, in the family's order. −1 if it is null.
  FamilyId AddFamily(std::shared_ptr<const FactorFamily> family);

  /// Connects the family's next factor to one variable per slot, with a loss (null: ½‖f‖²). Returns the factor's index in the
  /// family, or −1 if there is no such family. `variables` has family.num_slots() entries. Cost: no allocation beyond the growth
  /// of a vector; losses cost nothing while no factor of the family has one.
  int Connect(FamilyId family, const VariableId* variables, std::shared_ptr<const Loss> loss = nullptr);

  /// Connects several of the family's next factors at once, in less time than one after the other: num_slots variables each, and
  /// a loss each or no losses at all, else none is connected. Takes the vectors' memory over where the family has no factors yet.
  void ConnectMany(FamilyId family, std::vector<VariableId> variables, std::vector<std::shared_ptr<const Loss>> losses = {});

  /// Adds the measurement to a built-in family and connects it: graph.AddFactor(id, family, measurement, {camera, point}, loss).
  /// Returns −1, and adds no measurement, if `family` is not the one of this id or `variables` not one for each of its slots.
  template <typename Family>
  int AddFactor(FamilyId id, Family& family, const typename Family::Measurement& measurement,
                const std::vector<VariableId>& variables, std::shared_ptr<const Loss> loss = nullptr) {
    if (!CanAddFactor(id, family, variables)) {
      return -1;
    }
    family.Add(measurement);
    return Connect(id, variables.data(), std::move(loss));
  }

  void SetConstant(VariableId id, bool constant) { variables_[Index(id)].constant = constant; }
  void SetRole(VariableId id, Role role) { variables_[Index(id)].role = role; }
  /// Keeps the variable's values within bounds of ambient size each, which are copied; null means none on that side, and both
  /// null lift them. The batch Solve honors them: it projects the start, and every point it tries is x ⊞ δ clamped entry by
  /// entry, so the values of a variable with a manifold stay within their bounds but may leave the manifold, as in Ceres. They go
  /// with the variable when an edit removes it. Validate() refuses a lower bound that is not below its upper, and a constant
  /// outside its bounds. Cost: one node of a map for a bounded variable.
  void SetBounds(VariableId id, const double* lower, const double* upper);
  /// First-estimate Jacobians: from now on factors are linearized with this variable at these values (ambient size, copied) and
  /// the others where they are or are pinned; residuals and costs stay those of the current values. Null lets go of it. What it
  /// is for: a variable that a marginalization prior holds is linearized in one point only, so that no information appears along
  /// directions that nothing measured. A pinned variable costs its factors a second, cost-only evaluation a linearization. Its
  /// tangent coordinates at both points must mean the same, as in vector spaces and groups; those of a SphereManifold do not.
  /// Source: Huang, Mourikis & Roumeliotis, "A first-estimates Jacobian EKF for improving SLAM consistency", 2008.
  void PinLinearization(VariableId id, const double* values);
  /// Null means ½‖f‖².
  void SetLoss(FamilyId family, int factor, std::shared_ptr<const Loss> loss);
  /// Overwrites the values of a variable the graph owns; borrowed values are their owner's to change, so those are left alone.
  void SetValues(VariableId id, const double* values);
  void Reserve(int num_variables, int num_values);

  /// Carries out an edit begun on this graph: Check, then Commit. On an error, which names the id at fault, nothing has changed.
  /// Cost: proportional to the edit and the degrees of the variables it removes or frees; the first such edit makes one pass over
  /// the factors (TrackFactors).
  Status Apply(const GraphEdit& edit);
  /// The first half of Apply, for a caller with caches: says whether the edit can be carried out, and which factors it removes,
  /// those that go with their variables included, each once. Changes nothing that can be seen, but it reserves what Commit
  /// needs; so it counts as writing. In the steady state it allocates nothing. `removed` is empty after an error.
  Status Check(const GraphEdit& edit, std::vector<FactorId>* removed);
  /// The second half: carries out an edit that Check has passed, with the factors it named; the graph must be as it was then.
  /// Cannot fail, and allocates nothing of its own (a measurement set by the edit may).
  void Commit(const GraphEdit& edit, const std::vector<FactorId>& removed);

  /// Grows with every change of structure (AddVariable, AddFamily, Connect, Apply): an edit begun at another one is refused.
  std::int64_t revision() const { return revision_; }

  /// Keeps from now on a list of each variable's factors: two links a slot. One pass over the factors; later calls cost nothing.
  void TrackFactors();
  bool TracksFactors() const { return tracked_ && !untracked_ids_; }
  /// Calls f(FactorId) for every factor that touches the variable, the last connected first. Needs TrackFactors() before it.
  template <typename F>
  void ForEachFactorOf(VariableId id, F&& f) const {
    for (Touch touch = first_touches_[Index(id)]; touch.family >= 0;) {
      const FamilyRecord& record = families_[Index(touch.family)];
      const Touch next = record.links[Index(touch.entry)].next;
      f(FactorId{touch.family, touch.entry / record.family->num_slots()});
      touch = next;
    }
  }

  /// Ids given out, those of removed variables included.
  int num_variables() const { return static_cast<int>(variables_.size()); }
  int num_live_variables() const { return num_variables() - num_removed_variables_; }
  bool HasVariable(VariableId id) const { return id >= 0 && id < num_variables() && !variables_[Index(id)].removed; }
  int num_families() const { return static_cast<int>(families_.size()); }
  /// Factors of all families; free places do not count.
  int num_factors() const;

  int AmbientSize(VariableId id) const { return variables_[Index(id)].ambient_size; }
  int TangentSize(VariableId id) const { return variables_[Index(id)].tangent_size; }
  Role role(VariableId id) const { return variables_[Index(id)].role; }
  /// True if held constant by SetConstant, borrowed, or of tangent size 0; of a removed variable too.
  bool IsConstant(VariableId id) const { return variables_[Index(id)].constant || variables_[Index(id)].tangent_size == 0; }
  /// Null if no value of the variable is bounded.
  const VariableBounds* bounds(VariableId id) const {
    const auto found = bounds_.find(id);
    return found == bounds_.end() ? nullptr : &found->second;
  }
  bool HasBounds() const { return !bounds_.empty(); }
  const Manifold* manifold(VariableId id) const { return variables_[Index(id)].manifold.get(); }
  /// For whoever outlives the graph or the variable.
  const std::shared_ptr<const Manifold>& shared_manifold(VariableId id) const { return variables_[Index(id)].manifold; }
  /// Where the variable is linearized; null if where it is.
  const double* PinnedValues(VariableId id) const {
    const auto found = pins_.find(id);
    return found == pins_.end() ? nullptr : found->second.data();
  }
  bool HasPins() const { return !pins_.empty(); }
  const double* Values(VariableId id) const { return ValuesIn(state_.data(), id); }

  const FactorFamily& family(FamilyId id) const { return *families_[Index(id)].family; }
  /// Number of *connected* factors of the family: of its places, if some of them are free.
  int NumFactors(FamilyId id) const { return families_[Index(id)].num_factors; }
  int NumFreePlaces(FamilyId id) const { return static_cast<int>(families_[Index(id)].free_places.size()); }
  bool HasFactor(FamilyId id, int factor) const;
  /// The variables of factor i: num_slots entries, all -1 at a free place.
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

  /// What the next edit takes: the id of the k-th removed variable of this ambient size, or the k-th free place of a family,
  /// the one freed last first; -1 when there are no more.
  VariableId FreeVariable(int ambient_size, bool borrowed, int k) const;
  std::int32_t FreePlace(FamilyId id, int k) const;

  /// All owned values, one variable after the other in order of addition: what the solver copies, moves and writes back. The room
  /// of a removed variable holds zeros.
  const std::vector<double>& state() const { return state_; }
  std::vector<double>& mutable_state() { return state_; }
  /// Offset of the variable's values in the state, or -1 if they are borrowed.
  std::int64_t StateOffset(VariableId id) const { return variables_[Index(id)].offset; }
  /// The values of a variable in a given state vector (in borrowed memory for a borrowed constant).
  const double* ValuesIn(const double* state, VariableId id) const {
    const VariableRecord& variable = variables_[Index(id)];
    return variable.offset < 0 ? variable.borrowed : state + variable.offset;
  }

  /// Everything that makes the graph unsolvable, first culprit named: a call that could not be carried out, ids out of range,
  /// sizes that do not match a slot (of a constant only the ambient size counts) or the manifold, bounds that nothing can meet, a
  /// variable twice in a factor, two variable landmarks in a factor, a variable landmark of tangent size above 4, values that are
  /// null or not finite, a family that holds more or fewer measurements than were connected (more is fine once an edit was
  /// checked: a refused one may have placed some). Cost: one pass over factors and values; allocates for the message only.
  Status Validate() const;

  /// "factor 7 of BAL reprojection (variables 3, 112)": for messages.
  std::string DescribeFactor(FamilyId id, int factor) const;
  /// The same, and what went wrong with which number, what the family says of the factor (FactorFamily::Describe), and the first
  /// values of its variables, of which `parameters` holds one pointer a slot: at the point where it failed.
  std::string DescribeFailure(FamilyId id, const EvaluationFailure& failure, const double* const* parameters) const;
  /// What the user knows a variable by, for DescribeFailure: the address of a parameter block, say. Null: by its id.
  void SetVariableNames(std::function<std::string(VariableId)> name_of) { variable_name_ = std::move(name_of); }

 private:
  friend class internal::EditCheck;
  friend class internal::EditCommit;

  struct VariableRecord {
    std::int64_t offset = 0;  // into state_, or -1
    const double* borrowed = nullptr;
    std::shared_ptr<const Manifold> manifold;
    int ambient_size = 0;
    int tangent_size = 0;
    Role role = Role::kFrame;
    bool constant = false;
    bool removed = false;
  };
  // One slot of one factor: entry = factor · num_slots + slot.
  struct Touch {
    FamilyId family = -1;
    std::int32_t entry = -1;
  };
  // The neighbors of a touch in the list of its variable.
  struct Link {
    Touch previous;
    Touch next;
  };
  // kGoing and kComing only while an edit is checked.
  enum class Place : std::uint8_t { kIncremental, kFree, kGoing, kComing };
  struct FamilyRecord {
    std::shared_ptr<const FactorFamily> family;
    std::vector<VariableId> variables;                // factor-major, num_slots each
    std::vector<std::shared_ptr<const Loss>> losses;  // empty while no factor has one, else one a factor
    int num_factors = 0;                              // places
    std::vector<Place> places;                        // empty while no edit has looked at them, else one a place
    std::vector<std::int32_t> free_places;            // the last one is given out first
    std::vector<Link> links;                          // parallel to variables, once tracked
  };
  // What the edit being checked does to a variable.
  struct VariableMark {
    std::int32_t new_variable = -1;  // index among the variables that come
    bool going = false;
    bool checked = false;
    signed char constant = -1;  // set to 0 or 1
  };
  enum class Fault : std::uint8_t { kNone, kDanglingId, kRemoved, kGoing, kAmbientSize, kTangentSize, kRepeated, kTwoLandmarks };
  struct FactorFault {
    Fault fault = Fault::kNone;
    int slot = 0;  // the slot at fault; for a pair the later one
  };
  // A variable as a factor finds it: now, or after an edit. No record if there is a fault.
  struct Sight {
    const VariableRecord* record = nullptr;
    bool constant = false;
    Fault fault = Fault::kNone;
  };

  static std::size_t Index(std::int32_t id) { return static_cast<std::size_t>(id); }
  // Removed variables by their size: borrowed ones have no room of their own, so theirs are kept apart, as negative sizes.
  static int FreeKey(int ambient_size, bool borrowed) { return borrowed ? -ambient_size : ambient_size; }
  static VariableRecord MakeOwned(int ambient_size, Role role, std::shared_ptr<const Manifold> manifold);
  static VariableRecord MakeBorrowed(const double* values, int ambient_size);
  VariableId AppendVariable(VariableRecord variable, const double* values);
  bool CanAddFactor(FamilyId id, const FactorFamily& family, const std::vector<VariableId>& variables);
  bool HasFamily(const char* call, FamilyId id);
  bool Misused(std::string message);
  int AppendFactor(FamilyId family, const VariableId* variables, std::shared_ptr<const Loss> loss);
  void LinkFactor(FamilyId family, int factor);
  void UnlinkFactor(FamilyId family, int factor);

  Sight See(VariableId id) const;
  template <typename SeeVariable>
  static FactorFault FindFault(const FactorFamily& family, const VariableId* ids, const SeeVariable& see);
  static Status ValidateVariable(VariableId id, const VariableRecord& variable, bool constant);
  Status ValidateValues() const;
  Status ValidateBounds(VariableId id, const VariableBounds& bounds) const;
  Status ValidateFamily(FamilyId id) const;
  Status DescribeFault(FactorId id, const VariableId* ids, FactorFault fault, const VariableRecord* culprit) const;
  std::string DescribeFactor(FactorId id, const VariableId* ids) const;

  std::vector<VariableRecord> variables_;
  std::vector<FamilyRecord> families_;
  std::vector<double> state_;
  std::map<VariableId, VariableBounds> bounds_;     // of the bounded ones
  std::map<VariableId, std::vector<double>> pins_;  // of the pinned ones: their linearization points

  std::function<std::string(VariableId)> variable_name_;
  Status misuse_;  // the first call that could not be carried out

  // Of edited graphs only.
  std::int64_t revision_ = 0;
  bool edited_ = false;
  int num_removed_variables_ = 0;
  std::map<int, std::vector<VariableId>> free_variables_;  // by FreeKey; the last one is given out first
  bool tracked_ = false;
  bool untracked_ids_ = false;          // some factor names a variable that was not there when it was linked
  std::vector<Touch> first_touches_;    // one a variable, once tracked
  std::vector<VariableMark> marks_;     // scratch of Check
  std::vector<VariableRecord> comers_;  // scratch of Check: the variables that come
};

}  // namespace inceres
