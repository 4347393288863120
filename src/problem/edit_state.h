#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

/// A place of a family. kGoing and kComing only while an edit is checked.
enum class Place : std::uint8_t { kIncremental, kFree, kGoing, kComing };

/// One slot of one factor: entry = factor · num_slots + slot.
struct Touch {
  FamilyId family = -1;
  std::int32_t entry = -1;
};

/// The neighbors of a touch in the list of its variable.
struct Link {
  Touch previous;
  Touch next;
};

/// What the edit being checked does to a variable.
struct VariableMark {
  std::int32_t new_variable = -1;  // index among the variables that come
  bool going = false;
  bool checked = false;
  signed char constant = -1;  // set to 0 or 1
};

struct FamilyEditState {
  std::vector<Place> places;  // empty while no edit has looked at them, else one a place
  std::vector<std::int32_t> generations;  // as FactorGraph::Generation; of places beyond its end: 0
  std::vector<Link> links;                // parallel to the family's variables, once tracked
};

/// What a graph needs to be edited: which places and ids are free, the factors of each variable,
/// and the marks of an edit that is being checked.
struct EditState {
  bool edited = false;
  std::vector<FamilyEditState> families;
  // by FreeKey; the last one is given out first
  std::map<int, std::vector<VariableId>> free_variables;
  bool tracked = false;
  bool untracked_ids = false;  // some factor names a variable that was not there when it was linked
  std::vector<Touch> first_touches;    // one a variable, once tracked
  std::vector<VariableMark> marks;     // scratch of Check
  std::vector<VariableRecord> comers;  // scratch of Check: the variables that come
  // What the edit leaves of pins and bounds, made by Check, so that Commit need not allocate.
  std::map<VariableId, std::vector<double>> coming_pins;
  std::map<VariableId, VariableBounds> coming_bounds;
  bool measurements_placed = false;  // those of the edit that was checked last
};

/// Removed variables by their size: borrowed ones have no room of their own, so theirs are kept
/// apart, as negative sizes.
inline int FreeKey(int ambient_size, bool borrowed) {
  return borrowed ? -ambient_size : ambient_size;
}

VariableRecord MakeOwned(int ambient_size, Role role, std::shared_ptr<const Manifold> manifold);
VariableRecord MakeBorrowed(const double* values, int ambient_size);
/// As FactorGraph::SetBounds takes them; false if no value is bounded.
bool MakeBounds(const double* lower, const double* upper, int size, VariableBounds* bounds);

}  // namespace inceres::internal
