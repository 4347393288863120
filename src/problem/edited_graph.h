#pragma once

#include <algorithm>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres::internal {

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
