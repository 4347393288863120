#pragma once

/// Some functions of another Ceres, whose structs nobody may look into.
namespace foreign {

struct Opaque;

void Solve(const Opaque* options, Opaque* problem, Opaque* summary) __asm__(
    "_ZN5ceres5SolveERKNS_6Solver7OptionsEPNS_7ProblemEPNS0_7SummaryE");
void SolverSolve(Opaque* solver, const Opaque* options, Opaque* problem, Opaque* summary) __asm__(
    "_ZN5ceres6Solver5SolveERKNS0_7OptionsEPNS_7ProblemEPNS0_7SummaryE");
void MakeProblemWith(Opaque* problem,
                     const Opaque* options) __asm__("_ZN5ceres7ProblemC1ERKNS0_7OptionsE");
void EndProblem(Opaque* problem) __asm__("_ZN5ceres7ProblemD1Ev");
// clang-format off
void* AddResidualBlock(Opaque* problem, Opaque* cost, Opaque* loss, double* const* blocks,
                       int num_blocks) __asm__(
    "_ZN5ceres7Problem16AddResidualBlockEPNS_12CostFunctionEPNS_12LossFunctionEPKPdi");
// clang-format on

}  // namespace foreign
