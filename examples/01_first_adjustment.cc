// Lesson 1, the first adjustment: reads a bundle-adjustment problem, makes a factor graph of it and
// minimizes its reprojection error.
//
//     01_first_adjustment bal_data/street-16-1200-pre.txt
#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <iostream>
#include <memory>
#include <vector>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/io/bal.h"
#include "inceres/solver/solver.h"

namespace {

// [quoted in docs/lessons/01_first_adjustment.md]
struct Adjustment {
  inceres::FactorGraph graph;
  std::vector<inceres::VariableId> cameras, points;
};

void Build(const inceres::BalProblem& problem, Adjustment* adjustment) {
  inceres::FactorGraph& graph = adjustment->graph;
  const auto reprojections = graph.AddFamily(std::make_shared<inceres::BalReprojectionFamily>());
  for (int i = 0; i < problem.num_cameras; ++i) {
    adjustment->cameras.push_back(
        graph.AddVariable(problem.CameraData(i), 9, inceres::Role::kFrame));
  }
  for (int i = 0; i < problem.num_points; ++i) {
    adjustment->points.push_back(
        graph.AddVariable(problem.PointData(i), 3, inceres::Role::kLandmark));
  }
  for (const inceres::BalObservation& seen : problem.observations) {
    const inceres::VariableId camera = adjustment->cameras[static_cast<std::size_t>(seen.camera)];
    const inceres::VariableId point = adjustment->points[static_cast<std::size_t>(seen.point)];
    graph.AddFactor(reprojections, {seen.x, seen.y}, {camera, point});
  }
}
// [end of quote]

// [quoted in docs/lessons/01_first_adjustment.md]
void PrintTrace(const inceres::Summary& summary) {
  std::printf("iteration        cost   |gradient|   step kept\n");
  for (const inceres::IterationSummary& iteration : summary.iterations) {
    std::printf("%9d  %10.1f  %11.1e   %s\n", iteration.iteration, iteration.cost,
                iteration.gradient_max_norm, iteration.step_is_successful ? "yes" : "no");
  }
}
// [end of quote]

// Takes the solution out of the graph.
void WriteBack(const Adjustment& adjustment, inceres::BalProblem* problem) {
  for (int i = 0; i < problem->num_cameras; ++i) {
    const double* values = adjustment.graph.Values(adjustment.cameras[static_cast<std::size_t>(i)]);
    std::copy_n(values, 9, problem->CameraData(i));
  }
  for (int i = 0; i < problem->num_points; ++i) {
    const double* values = adjustment.graph.Values(adjustment.points[static_cast<std::size_t>(i)]);
    std::copy_n(values, 3, problem->PointData(i));
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: 01_first_adjustment FILE\n";
    return 2;
  }
  inceres::BalProblem problem;
  if (const inceres::Status status = inceres::ReadBal(argv[1], &problem); !status.ok()) {
    std::cerr << status.message << '\n';  // file, line and field
    return 1;
  }
  std::printf("%d cameras, %d points, %zu observations\n", problem.num_cameras, problem.num_points,
              problem.observations.size());
  std::printf("before: %.2f pixels root mean square\n\n", inceres::ReprojectionRms(problem));

  Adjustment adjustment;
  Build(problem, &adjustment);
  // [quoted in docs/lessons/01_first_adjustment.md]
  inceres::SolverOptions options;
  options.max_num_iterations = 30;
  const inceres::Summary summary = inceres::Solve(options, &adjustment.graph);
  if (!summary.IsSolutionUsable()) {
    std::cerr << summary.message << '\n' << summary.detail << '\n';  // which factor, and why
    return 1;
  }
  // [end of quote]
  PrintTrace(summary);
  WriteBack(adjustment, &problem);
  std::printf("\n%s\n", summary.BriefReport().c_str());
  std::printf("after: %.2f pixels root mean square\n", inceres::ReprojectionRms(problem));
  std::printf("%d landmarks eliminated; the rest is a system of %d unknowns, solved by %s\n",
              summary.work.num_landmarks, summary.work.reduced_size,
              summary.reduced_solver.c_str());
  return 0;
}
