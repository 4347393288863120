// A library with some of Ceres's symbols that is not the Ceres compiled for: by its SONAME, or by
// what else it has. It says what reaches it.
#include "dropin/foreign_ceres.h"

#include <cstdio>
#include <vector>

namespace foreign {

void Solve(const Opaque* options, Opaque* problem, Opaque* summary) {
  std::printf("free solve %d\n",
              static_cast<int>(options != nullptr && problem != nullptr && summary != nullptr));
  SolverSolve(nullptr, options, problem, summary);
}

void SolverSolve(Opaque* /*solver*/, const Opaque* /*options*/, Opaque* /*problem*/,
                 Opaque* /*summary*/) {
  std::printf("member solve\n");
}

void MakeProblemWith(Opaque* problem, const Opaque* options) {
  std::printf("problem %d\n", static_cast<int>(problem != nullptr && options != nullptr));
}

void EndProblem(Opaque* /*problem*/) {
  std::printf("problem ends\n");
}

void* AddResidualBlock(Opaque* problem, Opaque* /*cost*/, Opaque* /*loss*/,
                       double* const* /*blocks*/, int num_blocks) {
  std::printf("residual block of %d\n", num_blocks);
  return problem;
}

// What tells one release from another.
void FunctionOfAnotherRelease() __asm__(INCERES_FUNCTION_OF_ANOTHER_RELEASE);
void FunctionOfAnotherRelease() {
}

}  // namespace foreign

// What the loader must find when this library has that Ceres's SONAME: the virtual table of
// ceres::Solver.
extern "C" {
extern const void* const _ZTVN5ceres6SolverE[8];
const void* const _ZTVN5ceres6SolverE[8] = {};
}
