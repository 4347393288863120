#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "inceres/solver/incremental_solver.h"
#include "support/test_families.h"

namespace inceres::test {

/// A living problem of one variable of one, which is 1 to begin with, and one factor, whose
/// residual the function gives.
struct IncrementalFunction {
  IncrementalFunction(const IncrementalOptions& options, FunctionFamily::Function function)
      : solver(options) {
    const auto family = solver.AddFamily(std::make_shared<FunctionFamily>(
        1, std::vector<FactorFamily::Slot>{{1, 1}}, std::move(function)));
    GraphEdit edit(solver.graph());
    const double start = 1.0;
    x = edit.AddVariable(&start, 1, Role::kFrame);
    edit.AddFactor(family, 0, {x});
    applied = solver.Apply(edit).ok();
  }

  IncrementalSolver solver;
  VariableId x = -1;
  bool applied = false;
};

}  // namespace inceres::test
