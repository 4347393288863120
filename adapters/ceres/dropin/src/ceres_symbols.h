#pragma once

#include <type_traits>
#include <utility>
#include <vector>

#include <ceres/covariance.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include "adapters/ceres/read/ceres_version.h"

// Every function of Ceres that the drop-in stands in for, with its symbol, once: name, symbol, type
// with the object first. CMakeLists.txt reads the symbols from this file too: they are what
// libinceres_dropin.so exports and what --wrap wraps. Those of a release other than the one
// compiled for do no harm there.
//
// A member function is written as a function of its object, which it is in the Itanium C++ ABI on
// 64-bit machines, constructors and destructors of a class without virtual bases included. Each has
// two symbols: C1 and D1 for a whole object, C2 and D2 for one that a derived class contains.
#if INCERES_CERES_HAS_LOCAL_PARAMETERIZATIONS
#define INCERES_PARAMETERIZATION_SYMBOLS(X)                                                       \
  X(AddParameterBlockWithParameterization,                                                        \
    "_ZN5ceres7Problem17AddParameterBlockEPdiPNS_21LocalParameterizationE",                       \
    void(ceres::Problem*, double*, int, ceres::LocalParameterization*))                           \
  X(SetParameterization, "_ZN5ceres7Problem19SetParameterizationEPdPNS_21LocalParameterizationE", \
    void(ceres::Problem*, double*, ceres::LocalParameterization*))
#else
#define INCERES_PARAMETERIZATION_SYMBOLS(X)
#endif

#if INCERES_CERES_HAS_MANIFOLDS
#define INCERES_MANIFOLD_SYMBOLS(X)                                                          \
  X(AddParameterBlockWithManifold, "_ZN5ceres7Problem17AddParameterBlockEPdiPNS_8ManifoldE", \
    void(ceres::Problem*, double*, int, ceres::Manifold*))                                   \
  X(SetManifold, "_ZN5ceres7Problem11SetManifoldEPdPNS_8ManifoldE",                          \
    void(ceres::Problem*, double*, ceres::Manifold*))
#else
#define INCERES_MANIFOLD_SYMBOLS(X)
#endif

#define INCERES_COVARIANCE_SYMBOLS(X)                                                     \
  X(MakeCovariance, "_ZN5ceres10CovarianceC1ERKNS0_7OptionsE",                            \
    void(ceres::Covariance*, const ceres::Covariance::Options&))                          \
  X(MakeBaseCovariance, "_ZN5ceres10CovarianceC2ERKNS0_7OptionsE",                        \
    void(ceres::Covariance*, const ceres::Covariance::Options&))                          \
  X(EndCovariance, "_ZN5ceres10CovarianceD1Ev", void(ceres::Covariance*))                 \
  X(EndBaseCovariance, "_ZN5ceres10CovarianceD2Ev", void(ceres::Covariance*))             \
  X(ComputePairs,                                                                         \
    "_ZN5ceres10Covariance7ComputeERKSt6vectorISt4pairIPKdS4_ESaIS5_EE"                   \
    "PNS_7ProblemE",                                                                      \
    bool(ceres::Covariance*, const std::vector<std::pair<const double*, const double*>>&, \
         ceres::Problem*))                                                                \
  X(ComputeBlocks, "_ZN5ceres10Covariance7ComputeERKSt6vectorIPKdSaIS3_EEPNS_7ProblemE",  \
    bool(ceres::Covariance*, const std::vector<const double*>&, ceres::Problem*))         \
  X(GetBlock, "_ZNK5ceres10Covariance18GetCovarianceBlockEPKdS2_Pd",                      \
    bool(const ceres::Covariance*, const double*, const double*, double*))                \
  X(GetTangentBlock, "_ZNK5ceres10Covariance32GetCovarianceBlockInTangentSpaceEPKdS2_Pd", \
    bool(const ceres::Covariance*, const double*, const double*, double*))                \
  X(GetMatrix, "_ZNK5ceres10Covariance19GetCovarianceMatrixERKSt6vectorIPKdSaIS3_EEPd",   \
    bool(const ceres::Covariance*, const std::vector<const double*>&, double*))           \
  X(GetTangentMatrix,                                                                     \
    "_ZNK5ceres10Covariance33GetCovarianceMatrixInTangentSpaceERKSt6vectorIPKdSaIS3_EE"   \
    "Pd",                                                                                 \
    bool(const ceres::Covariance*, const std::vector<const double*>&, double*))

#define INCERES_CERES_SYMBOLS(X)                                                                   \
  INCERES_COVARIANCE_SYMBOLS(X)                                                                    \
  INCERES_PARAMETERIZATION_SYMBOLS(X)                                                              \
  INCERES_MANIFOLD_SYMBOLS(X)                                                                      \
  X(Solve, "_ZN5ceres5SolveERKNS_6Solver7OptionsEPNS_7ProblemEPNS0_7SummaryE",                     \
    void(const ceres::Solver::Options&, ceres::Problem*, ceres::Solver::Summary*))                 \
  X(SolverSolve, "_ZN5ceres6Solver5SolveERKNS0_7OptionsEPNS_7ProblemEPNS0_7SummaryE",              \
    void(ceres::Solver*, const ceres::Solver::Options&, ceres::Problem*, ceres::Solver::Summary*)) \
  X(MakeProblem, "_ZN5ceres7ProblemC1Ev", void(ceres::Problem*))                                   \
  X(MakeBaseProblem, "_ZN5ceres7ProblemC2Ev", void(ceres::Problem*))                               \
  X(MakeProblemWith, "_ZN5ceres7ProblemC1ERKNS0_7OptionsE",                                        \
    void(ceres::Problem*, const ceres::Problem::Options&))                                         \
  X(MakeBaseProblemWith, "_ZN5ceres7ProblemC2ERKNS0_7OptionsE",                                    \
    void(ceres::Problem*, const ceres::Problem::Options&))                                         \
  X(MoveProblem, "_ZN5ceres7ProblemC1EOS0_", void(ceres::Problem*, ceres::Problem*))               \
  X(MoveBaseProblem, "_ZN5ceres7ProblemC2EOS0_", void(ceres::Problem*, ceres::Problem*))           \
  X(AssignProblem, "_ZN5ceres7ProblemaSEOS0_", ceres::Problem*(ceres::Problem*, ceres::Problem*))  \
  X(EndProblem, "_ZN5ceres7ProblemD1Ev", void(ceres::Problem*))                                    \
  X(EndBaseProblem, "_ZN5ceres7ProblemD2Ev", void(ceres::Problem*))                                \
  X(AddResidualBlock,                                                                              \
    "_ZN5ceres7Problem16AddResidualBlockEPNS_12CostFunctionEPNS_12LossFunctionEPKPdi",             \
    ceres::ResidualBlockId(ceres::Problem*, ceres::CostFunction*, ceres::LossFunction*,            \
                           double* const*, int))                                                   \
  X(AddResidualBlockOn,                                                                            \
    "_ZN5ceres7Problem16AddResidualBlockEPNS_12CostFunctionEPNS_"                                  \
    "12LossFunctionERKSt6vectorIPdSaIS6_EE",                                                       \
    ceres::ResidualBlockId(ceres::Problem*, ceres::CostFunction*, ceres::LossFunction*,            \
                           const std::vector<double*>&))                                           \
  X(AddParameterBlock, "_ZN5ceres7Problem17AddParameterBlockEPdi",                                 \
    void(ceres::Problem*, double*, int))                                                           \
  X(RemoveParameterBlock, "_ZN5ceres7Problem20RemoveParameterBlockEPKd",                           \
    void(ceres::Problem*, const double*))                                                          \
  X(RemoveResidualBlock, "_ZN5ceres7Problem19RemoveResidualBlockEPNS_8internal13ResidualBlockE",   \
    void(ceres::Problem*, ceres::ResidualBlockId))                                                 \
  X(SetParameterBlockConstant, "_ZN5ceres7Problem25SetParameterBlockConstantEPKd",                 \
    void(ceres::Problem*, const double*))                                                          \
  X(SetParameterBlockVariable, "_ZN5ceres7Problem25SetParameterBlockVariableEPd",                  \
    void(ceres::Problem*, double*))                                                                \
  X(SetParameterLowerBound, "_ZN5ceres7Problem22SetParameterLowerBoundEPdid",                      \
    void(ceres::Problem*, double*, int, double))                                                   \
  X(SetParameterUpperBound, "_ZN5ceres7Problem22SetParameterUpperBoundEPdid",                      \
    void(ceres::Problem*, double*, int, double))

namespace inceres::internal {

/// Ceres's own functions, those that the drop-in's stand in front of.
struct NextCeres {
#define INCERES_DECLARE_NEXT(name, symbol, ...) std::add_pointer_t<__VA_ARGS__> name = nullptr;
  INCERES_CERES_SYMBOLS(INCERES_DECLARE_NEXT)
#undef INCERES_DECLARE_NEXT

  /// Whether this is the Ceres whose headers the drop-in was compiled with. If not, the layouts of
  /// its structs differ: nothing but the addresses above may be used, and everything goes through
  /// unread.
  bool is_ours = false;
  /// Whether the whole process calls the drop-in first. Where it is linked into a program, shared
  /// libraries of that may call Ceres directly; where a module that is linked to it was loaded
  /// RTLD_LOCAL, everybody else does. Then every Problem is looked through at every solve.
  bool sees_all_calls = false;
};

/// Found at the first call, then the same for good. Threads: any.
const NextCeres& Next();

}  // namespace inceres::internal
