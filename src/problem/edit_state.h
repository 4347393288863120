#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

/// What the edit being checked does to a variable.
struct VariableMark {
  std::int32_t new_variable = -1;  // index among the variables that come
  bool going = false;
  bool checked = false;
  signed char constant = -1;  // set to 0 or 1
};

/// What Check makes and keeps for Commit, and scratch memory of the former.
struct EditState {
  std::vector<VariableMark> marks;     // scratch of Check
  std::vector<VariableRecord> comers;  // scratch of Check: the variables that come
  // What the edit leaves of pins and bounds, made by Check, so that Commit need not allocate.
  std::map<VariableId, std::vector<double>> coming_pins;
  std::map<VariableId, VariableBounds> coming_bounds;
  bool measurements_placed = false;  // those of the edit that was checked last
};

/// A graph to one of its edits: as everyone sees it, and what it is made of.
struct EditedGraph {
  const FactorGraph* graph;
  VariableTable* variables;
  FactorTable* factors;
  EditState* scratch;
};

/// The record that an edit's AddVariable or AddBorrowedConstant makes.
template <typename NewVariable>
VariableRecord RecordOf(const NewVariable& added) {
  return added.is_borrowed ? VariableRecord::Borrowed(added.borrowed, added.ambient_size)
                           : VariableRecord::Owned(added.ambient_size, added.role, added.manifold);
}

/// As FactorGraph::SetBounds takes them; false if no value is bounded.
bool MakeBounds(const double* lower, const double* upper, int size, VariableBounds* bounds);

/// As push_back grows: a plain reserve would move everything at each edit. Twice as much as there
/// was, so that a graph that grows by edits moves its arrays as seldom as one that grows by itself.
template <typename T>
void ReserveRoom(std::vector<T>* values, std::size_t size) {
  if (values->capacity() < size) {
    values->reserve(std::max(size, 2 * values->capacity()));
  }
}

}  // namespace inceres::internal
