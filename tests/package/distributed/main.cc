// Solves a small BAL problem on all ranks with inceres::distributed from an installation: points
// are dealt out, each rank has all cameras.
#include <mpi.h>

#include <cstdio>
#include <vector>

#include <inceres/distributed/distributed_solver.h>
#include <inceres/io/bal.h>
#include <inceres/io/bal_graph.h>

namespace {

// Four cameras in a row look at a box of points; what they see is exact, start values are not.
inceres::BalProblem MakeProblem() {
  inceres::BalProblem bal;
  bal.num_cameras = 4;
  bal.num_points = 60;
  for (int c = 0; c < bal.num_cameras; ++c) {
    for (const double value : {0.0, 0.0, 0.0, 2.0 - c, 0.1 * c * c, -6.0, 500.0, 0.0, 0.0}) {
      bal.cameras.push_back(value);
    }
  }
  for (int p = 0; p < bal.num_points; ++p) {
    const double point[] = {-2.0 + 0.07 * p, -1.0 + 0.5 * (p % 5), -1.0 + 0.4 * (p % 7)};
    for (int c = 0; c < bal.num_cameras; ++c) {
      const double* const t = bal.cameras.data() + 9 * c + 3;
      const double depth = -(point[2] + t[2]);
      bal.observations.push_back(
          {c, p, 500.0 * (point[0] + t[0]) / depth, 500.0 * (point[1] + t[1]) / depth});
    }
    for (const double value : point) {
      bal.points.push_back(value + 0.01 * (p % 3));
    }
  }
  return bal;
}

}  // namespace

int main(int argc, char** argv) {
  MPI_Init(&argc, &argv);
  int rank = 0, size = 1;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  inceres::BalProblem bal = MakeProblem();
  const auto all = bal.observations;
  bal.observations.clear();
  for (const auto& seen : all) {
    if (seen.point % size == rank) {
      bal.observations.push_back(seen);
    }
  }
  int failed = 1;
  {
    inceres::FactorGraph graph;
    const inceres::BalGraph ids = inceres::AddBal(bal, nullptr, &graph);
    inceres::GraphPart part;
    part.graph = &graph;
    for (int c = 0; c < bal.num_cameras; ++c) {
      part.frames.push_back({c, ids.cameras[c]});
    }
    inceres::DistributedSolver solver(MPI_COMM_WORLD, inceres::DistributedOptions());
    const inceres::DistributedSummary summary = solver.Solve(part);
    const inceres::Summary& solve = summary.solve;
    std::printf("rank %d of %d: cost %g -> %g, %s\n", rank, size, solve.initial_cost,
                solve.final_cost, solve.message.c_str());
    failed = solve.IsSolutionUsable() && solve.final_cost < 1e-6 * solve.initial_cost ? 0 : 1;
  }
  MPI_Finalize();
  return failed;
}
