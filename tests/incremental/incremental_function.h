#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "inceres/solver/incremental_solver.h"
#include "support/test_families.h"

namespace inceres::test {

/// A living problem of one variable of one, which is 1 to begin with, and one factor, whose
/// residuals the function gives.
struct IncrementalFunction {
  IncrementalFunction(const IncrementalOptions& options, FunctionFamily::Function function,
                      int num_residuals = 1, double start = 1.0,
                      const std::shared_ptr<const Loss>& loss = nullptr)
      : solver(options) {
    const auto family = solver.AddFamily(std::make_shared<FunctionFamily>(
        num_residuals, std::vector<FactorFamily::Slot>{{1, 1}}, std::move(function)));
    GraphEdit edit(solver.graph());
    x = edit.AddVariable(&start, 1, Role::kFrame);
    factor = edit.AddFactor(family, 0, {x}, loss);
    applied = solver.Apply(edit).ok();
  }

  IncrementalSolver solver;
  VariableId x = -1;
  FactorId factor;
  bool applied = false;
};

}  // namespace inceres::test
