// A program of another Ceres: reading any of the structs it passes is an access violation.
#include <cstdio>

#include <sys/mman.h>

#include "dropin/foreign_ceres.h"

int main() {
  void* forbidden = mmap(nullptr, 4096, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (forbidden == MAP_FAILED) {
    return 2;
  }
  auto* opaque = static_cast<foreign::Opaque*>(forbidden);
  double* block = nullptr;
  foreign::MakeProblemWith(opaque, opaque);
  const bool passed = foreign::AddResidualBlock(opaque, opaque, opaque, &block, 3) == forbidden;
  foreign::Solve(opaque, opaque, opaque);
  foreign::EndProblem(opaque);
  std::printf("%s\n", passed ? "returned" : "lost");
  return 0;
}
