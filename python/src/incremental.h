#pragma once

#include <memory>
#include <vector>

#include "graph.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_solver.h"

namespace inceres::python {

struct LivingSolver : std::enable_shared_from_this<LivingSolver> {
  explicit LivingSolver(const IncrementalOptions& options) : core(options) {}

  IncrementalSolver core;
  Families families;
  Occupation occupation;
};

/// Factors that an edit adds to a family. They wait until it is applied: another edit that was
/// begun on the same graph has given out the same places.
struct ComingFactors {
  Family* family;
  std::vector<std::int32_t> places;
  std::vector<VariableId> variables;  // num_slots each
  std::vector<double> measurements;   // num_columns each
  int num_columns;

  void Place() const;
};

/// An edit of a solver's graph, which it keeps alive.
struct Edit {
  explicit Edit(std::shared_ptr<LivingSolver> of)
      : solver(std::move(of)), core(solver->core.graph()) {}
  void Restart();

  std::shared_ptr<LivingSolver> solver;
  GraphEdit core;
  std::vector<ComingFactors> coming;
};

/// Carries the edit out, or raises; a new one can begin in the same object.
void ApplyEdit(Edit* edit);

void BindEdit(py::module_& module);

}  // namespace inceres::python
