#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_family.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"

namespace inceres {

/// Names a variable of a graph; −1: none.
using VariableId = std::int32_t;
/// Names a family of a graph; −1: none.
using FamilyId = std::int32_t;

/// Names a factor of a graph: its family and its place there. The place of a removed factor is
/// given to a later one: ids that a GraphEdit has given know which one they mean, and an edit
/// refuses them once it is gone.
struct FactorId {
  FamilyId family = -1;          ///< −1: none
  std::int32_t index = -1;       ///< its place in the family
  std::int32_t generation = -1;  ///< factors that had the place before; -1: whichever has it
};

/// Bounds on the values of a variable, one entry a value: lower ≤ x ≤ upper. ∓infinity, or ∓the
/// largest double, means none.
struct VariableBounds {
  std::vector<double> lower;  ///< as many as the variable has values
  std::vector<double> upper;  ///< likewise
};

/// What the solver does with a variable: landmarks (tangent size 1 to 4, at most one a factor) are
/// eliminated first, one small block each; frames (poses, velocities, calibrations, …) stay in the
/// reduced system.
enum class Role : std::uint8_t {
  kFrame,     ///< stays in the reduced system
  kLandmark,  ///< eliminated first
};

// What a FactorGraph is made of (factor_graph.h), in classes that keep one thing in order each.
namespace internal {

inline std::size_t IndexOf(std::int32_t id) {
  return static_cast<std::size_t>(id);
}

struct VariableRecord {
  // Offset 0 stands for owned values until a table gives them room; −1: borrowed.
  static VariableRecord Owned(int ambient_size, Role role,
                              std::shared_ptr<const Manifold> manifold);
  static VariableRecord Borrowed(const double* values, int ambient_size);

  std::int64_t offset = 0;  // into the state, or -1
  std::int64_t serial = 0;  // as FactorGraph::VariableSerial
  const double* borrowed = nullptr;
  std::shared_ptr<const Manifold> manifold;
  int ambient_size = 0;
  int tangent_size = 0;
  std::int32_t group = 0;
  Role role = Role::kFrame;
  bool constant = false;
  bool removed = false;
};

// The variables of a graph and the values they own, one after the other; bounds, pins and groups of
// the few that have some. A removed variable leaves its id and its room, which holds zeros, to a
// later one of the same size.
class INCERES_EXPORT VariableTable {
 public:
  int size() const { return static_cast<int>(records_.size()); }
  int num_removed() const { return num_removed_; }
  int num_grouped() const { return num_grouped_; }
  std::int64_t num_added() const { return num_added_; }
  bool Has(VariableId id) const { return id >= 0 && id < size() && !(*this)[id].removed; }
  const VariableRecord& operator[](VariableId id) const { return records_[IndexOf(id)]; }
  const std::vector<double>& state() const { return state_; }
  std::vector<double>& mutable_state() { return state_; }
  const std::map<VariableId, VariableBounds>& bounds() const { return bounds_; }
  const std::map<VariableId, std::vector<double>>& pins() const { return pins_; }

  // Values that are owned are copied; a null pointer leaves NaN.
  VariableId Append(VariableRecord variable, const double* values);
  void SetValues(VariableId id, const double* values);
  void SetConstant(VariableId id, bool constant) { records_[IndexOf(id)].constant = constant; }
  void SetRole(VariableId id, Role role) { records_[IndexOf(id)].role = role; }
  void SetGroup(VariableId id, int group);
  void SetBounds(VariableId id, const double* lower, const double* upper);
  void Pin(VariableId id, const double* values);
  void DropBounds(VariableId id) { bounds_.erase(id); }
  // Of variables that have none. Moves nodes of maps, which allocates nothing.
  void TakeBounds(std::map<VariableId, VariableBounds>* coming) { bounds_.merge(*coming); }
  void TakePins(std::map<VariableId, std::vector<double>>* coming) { pins_.merge(*coming); }

  // Takes a variable out; its id is given out once it is freed.
  void Remove(VariableId id);
  void Free(VariableId id) { free_[KeyOf((*this)[id])].push_back(id); }
  // The id that is given out after k others of this size; −1: a new one.
  VariableId FreeId(int ambient_size, bool borrowed, int k) const;
  // Puts a variable of the same size in the place of the one whose id was freed last.
  void Reuse(VariableId id, VariableRecord variable, const double* values);

  void Reserve(int num_variables, int num_values);
  // So that so many Append, with so many values, and Free of the listed ones allocate nothing.
  void ReserveFor(std::size_t num_new, std::size_t num_values, const std::vector<VariableId>& free);

 private:
  // Borrowed ones have no room of their own, so theirs are kept apart, as negative sizes.
  static int Key(int ambient_size, bool borrowed) {
    return borrowed ? -ambient_size : ambient_size;
  }
  static int KeyOf(const VariableRecord& variable) {
    return Key(variable.ambient_size, variable.offset < 0);
  }

  std::vector<VariableRecord> records_;
  std::vector<double> state_;
  std::map<VariableId, VariableBounds> bounds_;     // of the bounded ones
  std::map<VariableId, std::vector<double>> pins_;  // of the pinned ones
  std::map<int, std::vector<VariableId>> free_;     // by Key; the last one is given out first
  std::int64_t num_added_ = 0;                      // ever, under whatever id
  int num_removed_ = 0;
  int num_grouped_ = 0;  // in another group than 0
};

// What the edit being checked does to a variable.
struct VariableMark {
  std::int32_t new_variable = -1;  // index among the variables that come
  bool going = false;
  bool checked = false;
  signed char constant = -1;  // set to 0 or 1
};

// What FactorGraph::Check makes and keeps for Commit, and scratch memory of the former.
struct EditState {
  std::vector<VariableMark> marks;     // scratch of Check
  std::vector<VariableRecord> comers;  // scratch of Check: the variables that come
  // What the edit leaves of pins and bounds, made by Check, so that Commit need not allocate.
  std::map<VariableId, std::vector<double>> coming_pins;
  std::map<VariableId, VariableBounds> coming_bounds;
  bool measurements_placed = false;  // those of the edit that was checked last
};

// A place of a family. kGoing and kComing only while an edit is checked.
enum class PlaceState : std::uint8_t { kIncremental, kFree, kGoing, kComing };

struct FamilyRecord {
  std::shared_ptr<const FactorFamily> family;
  std::vector<VariableId> variables;  // factor-major, num_slots each
  std::vector<std::shared_ptr<const Loss>>
      losses;                             // empty while no factor has one, else one a factor
  int num_factors = 0;                    // places
  std::vector<std::int32_t> free_places;  // the last one is given out first
  std::vector<PlaceState> places;  // empty while no edit has looked at them, else one a place
  // as FactorGraph::Generation; of places beyond its end: 0
  std::vector<std::int32_t> generations;
};

// The factors of each variable, as doubly linked lists through the slots of all families: a factor
// joins and leaves in O(num_slots). Nothing is kept until someone asks for it.
class INCERES_EXPORT FactorLists {
 public:
  // One slot of one factor: entry = factor · num_slots + slot. The family −1: none.
  struct Touch {
    FamilyId family = -1;
    std::int32_t entry = -1;
  };

  bool kept() const { return kept_; }
  // Some factor names a variable that was not there when it was linked.
  bool has_gaps() const { return has_gaps_; }
  Touch First(VariableId id) const { return first_[IndexOf(id)]; }
  Touch Next(Touch touch) const { return links_[IndexOf(touch.family)][IndexOf(touch.entry)].next; }

  // Lists of all factors, whatever was kept before.
  void Build(const std::vector<FamilyRecord>& families, int num_variables);
  void AddVariable();
  // The families are those of Build, or have come since.
  void Link(FamilyId id, const FamilyRecord& family, int factor);
  void Unlink(FamilyId id, const FamilyRecord& family, int factor);
  // So that variables up to this number can come, or factors up to so many entries of a family.
  void ReserveVariables(std::size_t size);
  void ReserveEntries(FamilyId id, std::size_t size);

 private:
  struct LinkPair {
    Touch previous;
    Touch next;
  };

  bool kept_ = false;
  bool has_gaps_ = false;
  std::vector<Touch> first_;                  // one a variable
  std::vector<std::vector<LinkPair>> links_;  // of each family: parallel to its variables
};

// The families of a graph with what connects their factors. The place of a removed factor, which
// names variables of −1, goes to a later one.
class INCERES_EXPORT FactorTable {
 public:
  int size() const { return static_cast<int>(records_.size()); }
  bool Has(FamilyId id) const { return id >= 0 && id < size(); }
  const FamilyRecord& operator[](FamilyId id) const { return records_[IndexOf(id)]; }
  const FactorLists& lists() const { return lists_; }
  int num_factors() const;
  bool HasFactor(FamilyId id, int factor) const;
  std::int32_t FreePlace(FamilyId id, int k) const;
  std::int32_t Generation(FamilyId id, std::int32_t place) const;

  FamilyId AddFamily(std::shared_ptr<const FactorFamily> family);
  // A family as it stands in a file, with its free places.
  void Restore(FamilyRecord record) { records_.push_back(std::move(record)); }
  int Append(FamilyId id, const VariableId* variables, std::shared_ptr<const Loss> loss);
  // All factors of a family that has none. Requires that no lists are kept.
  void TakeOver(FamilyId id, std::vector<VariableId> variables,
                std::vector<std::shared_ptr<const Loss>> losses);
  void SetLoss(FamilyId id, int factor, std::shared_ptr<const Loss> loss);
  void KeepLists(int num_variables);
  // For the lists: a variable more, or room for so many.
  void AddVariable() { lists_.AddVariable(); }
  void ReserveVariables(std::size_t size) { lists_.ReserveVariables(size); }

  // What an edit finds at a place: without marks all below num_factors are factors.
  PlaceState PlaceOf(FactorId id) const;
  // The array comes into being with the first mark, as far as the family or the place goes.
  void MarkPlace(FactorId id, PlaceState place);
  // Cuts off places that were marked beyond the family's.
  void ForgetPlacesBeyond(FamilyId id);

  void Remove(FactorId id);
  // The place of a removed factor is given out from now on.
  void Free(FactorId id);
  // Connects a factor at the place that was freed last.
  void Reuse(FactorId id, const VariableId* variables, std::shared_ptr<const Loss> loss);
  // So that the family can free so many more places, or connect a factor at each place marked, or
  // set losses, without allocating.
  void ReserveFree(FamilyId id, std::size_t count);
  void ReserveMarked(FamilyId id, bool with_loss);
  void ReserveLosses(FamilyId id);

 private:
  std::vector<FamilyRecord> records_;
  FactorLists lists_;
};

}  // namespace internal
}  // namespace inceres
