// A program that leaves MPI and PETSc to DistributedSolver, and one that starts MPI itself
// ("own_mpi"): at exit all that the solver has started is ended. Not of GoogleTest: what is looked
// at comes after main.
#include <mpi.h>
#include <petscsys.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "inceres/distributed/distributed_solver.h"

namespace {

bool owns_mpi = false;

// Runs last, for it is registered first.
void CheckEnd() {
  PetscBool petsc_ended = PETSC_FALSE;
  int mpi_ended = 0;
  PetscFinalized(&petsc_ended);
  MPI_Finalized(&mpi_ended);
  if (mpi_ended == 0 || (petsc_ended == PETSC_TRUE) == owns_mpi) {
    std::fprintf(stderr, "at the end of the program: MPI ended: %d, PETSc ended: %d\n", mpi_ended,
                 static_cast<int>(petsc_ended));
    std::_Exit(3);
  }
}

bool SolvesNothing() {
  inceres::FactorGraph graph;
  inceres::GraphPart part;
  part.graph = &graph;
  inceres::DistributedSolver solver(MPI_COMM_WORLD, inceres::DistributedOptions());
  return solver.Solve(part).solve.IsSolutionUsable();
}

}  // namespace

int main(int argc, char** argv) {
  std::atexit(&CheckEnd);
  owns_mpi = argc > 1 && std::strcmp(argv[1], "own_mpi") == 0;
  if (owns_mpi) {
    MPI_Init(&argc, &argv);
  }
  // The second one finds PETSc as the first has left it.
  const bool solved = SolvesNothing() && SolvesNothing();
  if (owns_mpi) {
    MPI_Finalize();
  }
  return solved ? 0 : 1;
}
