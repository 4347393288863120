#pragma once

#include <memory>
#include <vector>

#include "graph.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/solver/incremental_solver.h"

namespace inceres::python {

struct LivingSolver {
  explicit LivingSolver(const IncrementalOptions& options) : core(options) {}

  IncrementalSolver core;
  Families families;
  Occupation occupation;
};

/// An edit of a solver's graph, which it keeps alive.
struct Edit {
  explicit Edit(std::shared_ptr<LivingSolver> of)
      : solver(std::move(of)), core(solver->core.graph()) {}

  std::shared_ptr<LivingSolver> solver;
  GraphEdit core;
};

/// Carries the edit out, or raises; a new one can begin in the same object.
void ApplyEdit(Edit* edit);

void BindEdit(py::module_& module);

}  // namespace inceres::python
