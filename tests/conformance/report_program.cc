// Solves several problems as a program would that shows its user all there is: progress table,
// callbacks' lines, the long report and the result, to the last bit with one thread.
// check_same_output.py compares what two runs print.
#include <cstdio>
#include <iostream>

#include "conformance/support.h"

namespace {

using conformance::Options;
using conformance::World;

void SolveAndPrint(const char* name, Options options, World* world) {
  std::cout << "== " << name << std::endl;
  conformance::Callback callback([&](const ceres::IterationSummary& iteration) {
    std::cout << "callback " << iteration.iteration << std::endl;
    return ceres::SOLVER_CONTINUE;
  });
  options.callbacks.insert(options.callbacks.begin(), &callback);
  options.minimizer_progress_to_stdout = true;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &world->problem, &summary);
  std::cout << summary.FullReport() << summary.BriefReport() << std::endl;
  // On two threads Ceres adds up in the order in which they come: one run in twenty ends with other
  // last bits.
  const char* format = options.num_threads == 1 ? "%a " : "%.9g ";
  for (const auto& block : world->blocks) {
    for (const double value : block) {
      std::printf(format, value);
    }
    std::printf("\n");
  }
  std::fflush(stdout);
}

void SolveBundles() {
  for (const auto type : {ceres::DENSE_SCHUR, ceres::SPARSE_SCHUR, ceres::ITERATIVE_SCHUR,
                          ceres::SPARSE_NORMAL_CHOLESKY}) {
    conformance::Bundle bundle(4, 20);
    bundle.problem.SetParameterBlockConstant(bundle.cameras[0]);
    Options options;
    options.linear_solver_type = type;
    SolveAndPrint(ceres::LinearSolverTypeToString(type), options, &bundle);
  }
  conformance::Bundle bundle;
  Options options = conformance::Schur();
  options.trust_region_strategy_type = ceres::DOGLEG;
  options.num_threads = 2;
  options.update_state_every_iteration = true;
  SolveAndPrint("dogleg", options, &bundle);
}

void SolveRosenbrock() {
  for (const bool nonmonotonic : {false, true}) {
    conformance::Rosenbrock rosenbrock;
    Options options = conformance::Small();
    options.use_nonmonotonic_steps = nonmonotonic;
    SolveAndPrint(nonmonotonic ? "nonmonotonic" : "rejected steps", options, &rosenbrock);
  }
  conformance::Rosenbrock bounded;
  bounded.problem.SetParameterUpperBound(bounded.x, 0, 0.5);
  SolveAndPrint("bounds", conformance::Small(), &bounded);
  conformance::Rosenbrock searched;
  Options options = conformance::Small();
  options.minimizer_type = ceres::LINE_SEARCH;
  SolveAndPrint("line search", options, &searched);
}

void EndOtherwise() {
  conformance::Rosenbrock aborted;
  conformance::Callback abort([](const ceres::IterationSummary& iteration) {
    return iteration.iteration == 3 ? ceres::SOLVER_ABORT : ceres::SOLVER_CONTINUE;
  });
  Options options = conformance::Small();
  options.callbacks.push_back(&abort);
  SolveAndPrint("abort", options, &aborted);
  conformance::Line failing;
  failing.problem.AddResidualBlock(new conformance::Cost(1, {1}, [](auto...) { return false; }),
                                   nullptr, failing.x);
  SolveAndPrint("failure", conformance::Small(), &failing);
  conformance::Line constant;
  constant.problem.SetParameterBlockConstant(constant.x);
  SolveAndPrint("nothing to solve", conformance::Small(), &constant);
  conformance::Line line;
  options = conformance::Small();
  options.max_num_iterations = -1;
  SolveAndPrint("invalid options", options, &line);
}

}  // namespace

int main() {
  SolveBundles();
  SolveRosenbrock();
  EndOtherwise();
  return 0;
}
