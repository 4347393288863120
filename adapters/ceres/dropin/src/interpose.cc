// The functions that stand in for Ceres's. Compiled twice: under Ceres's own symbols for the shared
// library, under __wrap_… for a program linked with --wrap.
#include "adapters/ceres/dropin/src/ceres_symbols.h"
#include "adapters/ceres/dropin/src/dropin_solve.h"
#include "adapters/ceres/dropin/src/registry.h"
#include "adapters/ceres/read/ceres_version.h"
#include "adapters/ceres/report/environment.h"
#include "inceres/ceres/dropin.h"

namespace inceres::internal::interposed {

#define INCERES_DECLARE_INTERPOSED(name, symbol, ...)                                           \
  [[gnu::visibility("default")]] std::remove_pointer_t<decltype(NextCeres::name)> name __asm__( \
      INCERES_SYMBOL_PREFIX symbol);
INCERES_CERES_SYMBOLS(INCERES_DECLARE_INTERPOSED)
#undef INCERES_DECLARE_INTERPOSED

namespace {

// Whether anything but passing calls through is to be done at all.
bool IsActive() {
  static const bool kActive = TheEnvironment().mode != DropinMode::kStock && Next().is_ours;
  return kActive;
}

// Whether edits are of interest.
bool Remembers() {
  static const bool kRemembers = IsActive() && (TheEnvironment().mode == DropinMode::kIncremental ||
                                                TheEnvironment().mode == DropinMode::kAuto);
  return kRemembers;
}

// `added`: the cost function of a new residual block, else null. Before its first solve everything
// of a Problem is new.
void NoteEdit(const ceres::Problem* problem, const ceres::CostFunction* added) {
  KnownProblem* known = Remembers() ? TheRegistry().Find(problem) : nullptr;
  if (known == nullptr || known->num_solves == 0) {
    return;
  }
  known->edited = true;
  if (added != nullptr) {
    known->added_cost_functions.push_back(added);
  }
}

// In every mode, also before the first solve: without, nobody looks for any.
void NoteBounds(const ceres::Problem* problem) {
  KnownProblem* known = IsActive() ? TheRegistry().Find(problem) : nullptr;
  if (known != nullptr) {
    known->has_bounds = true;
  }
}

template <typename... Parameters, typename... Arguments>
void Edit(void (*next)(ceres::Problem*, Parameters...), ceres::Problem* problem,
          Arguments... arguments) {
  next(problem, arguments...);
  NoteEdit(problem, nullptr);
}

void NoteNew(const ceres::Problem* problem, ceres::EvaluationCallback* evaluation_callback) {
  if (IsActive()) {
    TheRegistry().Add(problem, std::make_unique<KnownProblem>(evaluation_callback));
  }
}

void NoteNew(const ceres::Problem* problem, const ceres::Problem::Options& options) {
  if (IsActive()) {  // else the layout of the options may be another
    TheRegistry().Add(problem, std::make_unique<KnownProblem>(options.evaluation_callback));
  }
}

void NoteMove(const ceres::Problem* from, const ceres::Problem* to) {
  if (IsActive()) {
    TheRegistry().Move(from, to);
  }
}

// Before the destructor runs: another thread may construct a Problem at this address as soon as it
// is free.
void NoteEnd(const ceres::Problem* problem) {
  if (IsActive()) {
    TheRegistry().Take(problem);
  }
}

// False if it is stock's to do. What was computed before is forgotten.
bool ComputeInsteadOfCeres(const ceres::Covariance* covariance,
                           const ProblemCovariance::Pairs& pairs, const ceres::Problem* problem,
                           bool* computed) {
  if (!IsActive() || TheEnvironment().mode == DropinMode::kFallback) {
    return false;
  }
  const KnownProblem* known = TheRegistry().Find(problem);
  if (known == nullptr) {  // so it may have an evaluation callback
    TheCovariances().Forget(covariance);
    return false;
  }
  return TheCovariances().Compute(covariance, pairs, *problem,
                                  EvaluationCallbackOf(*problem, known->evaluation_callback),
                                  computed);
}

}  // namespace

void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
           ceres::Solver::Summary* summary) {
  if (IsActive()) {
    SolveInsteadOfCeres(TheEnvironment(), TheRegistry().Find(problem), options, problem, summary);
  } else {
    Next().Solve(options, problem, summary);
  }
}

void SolverSolve(ceres::Solver* solver, const ceres::Solver::Options& options,
                 ceres::Problem* problem, ceres::Solver::Summary* summary) {
  if (IsActive()) {
    SolveInsteadOfCeres(TheEnvironment(), TheRegistry().Find(problem), options, problem, summary);
  } else {
    Next().SolverSolve(solver, options, problem, summary);
  }
}

void MakeProblem(ceres::Problem* problem) {
  Next().MakeProblem(problem);
  NoteNew(problem, nullptr);
}

void MakeBaseProblem(ceres::Problem* problem) {
  Next().MakeBaseProblem(problem);
  NoteNew(problem, nullptr);
}

void MakeProblemWith(ceres::Problem* problem, const ceres::Problem::Options& options) {
  Next().MakeProblemWith(problem, options);
  NoteNew(problem, options);
}

void MakeBaseProblemWith(ceres::Problem* problem, const ceres::Problem::Options& options) {
  Next().MakeBaseProblemWith(problem, options);
  NoteNew(problem, options);
}

void MoveProblem(ceres::Problem* problem, ceres::Problem* from) {
  Next().MoveProblem(problem, from);
  NoteMove(from, problem);
}

void MoveBaseProblem(ceres::Problem* problem, ceres::Problem* from) {
  Next().MoveBaseProblem(problem, from);
  NoteMove(from, problem);
}

ceres::Problem* AssignProblem(ceres::Problem* problem, ceres::Problem* from) {
  ceres::Problem* result = Next().AssignProblem(problem, from);
  NoteMove(from, problem);
  return result;
}

void EndProblem(ceres::Problem* problem) {
  NoteEnd(problem);
  Next().EndProblem(problem);
}

void EndBaseProblem(ceres::Problem* problem) {
  NoteEnd(problem);
  Next().EndBaseProblem(problem);
}

ceres::ResidualBlockId AddResidualBlock(ceres::Problem* problem, ceres::CostFunction* cost,
                                        ceres::LossFunction* loss, double* const* blocks,
                                        int num_blocks) {
  const ceres::ResidualBlockId id =
      Next().AddResidualBlock(problem, cost, loss, blocks, num_blocks);
  NoteEdit(problem, cost);
  return id;
}

ceres::ResidualBlockId AddResidualBlockOn(ceres::Problem* problem, ceres::CostFunction* cost,
                                          ceres::LossFunction* loss,
                                          const std::vector<double*>& blocks) {
  const ceres::ResidualBlockId id = Next().AddResidualBlockOn(problem, cost, loss, blocks);
  NoteEdit(problem, cost);
  return id;
}

void AddParameterBlock(ceres::Problem* problem, double* values, int size) {
  Edit(Next().AddParameterBlock, problem, values, size);
}

#if INCERES_CERES_HAS_LOCAL_PARAMETERIZATIONS

void AddParameterBlockWithParameterization(ceres::Problem* problem, double* values, int size,
                                           ceres::LocalParameterization* parameterization) {
  Edit(Next().AddParameterBlockWithParameterization, problem, values, size, parameterization);
}

void SetParameterization(ceres::Problem* problem, double* values,
                         ceres::LocalParameterization* parameterization) {
  Edit(Next().SetParameterization, problem, values, parameterization);
}

#endif

#if INCERES_CERES_HAS_MANIFOLDS

void AddParameterBlockWithManifold(ceres::Problem* problem, double* values, int size,
                                   ceres::Manifold* manifold) {
  Edit(Next().AddParameterBlockWithManifold, problem, values, size, manifold);
}

void SetManifold(ceres::Problem* problem, double* values, ceres::Manifold* manifold) {
  Edit(Next().SetManifold, problem, values, manifold);
}

#endif

void RemoveParameterBlock(ceres::Problem* problem, const double* values) {
  Edit(Next().RemoveParameterBlock, problem, values);
}

void RemoveResidualBlock(ceres::Problem* problem, ceres::ResidualBlockId id) {
  Edit(Next().RemoveResidualBlock, problem, id);
}

void SetParameterBlockConstant(ceres::Problem* problem, const double* values) {
  Edit(Next().SetParameterBlockConstant, problem, values);
}

void SetParameterBlockVariable(ceres::Problem* problem, double* values) {
  Edit(Next().SetParameterBlockVariable, problem, values);
}

void SetParameterLowerBound(ceres::Problem* problem, double* values, int index, double bound) {
  Edit(Next().SetParameterLowerBound, problem, values, index, bound);
  NoteBounds(problem);
}

void SetParameterUpperBound(ceres::Problem* problem, double* values, int index, double bound) {
  Edit(Next().SetParameterUpperBound, problem, values, index, bound);
  NoteBounds(problem);
}

void MakeCovariance(ceres::Covariance* covariance, const ceres::Covariance::Options& options) {
  Next().MakeCovariance(covariance, options);
  if (IsActive()) {  // else the layout of the options may be another
    TheCovariances().Add(covariance, std::make_unique<KnownCovariance>(options));
  }
}

void MakeBaseCovariance(ceres::Covariance* covariance, const ceres::Covariance::Options& options) {
  Next().MakeBaseCovariance(covariance, options);
  if (IsActive()) {
    TheCovariances().Add(covariance, std::make_unique<KnownCovariance>(options));
  }
}

// Before the destructor runs, as with a Problem.
void EndCovariance(ceres::Covariance* covariance) {
  TheCovariances().Take(covariance);
  Next().EndCovariance(covariance);
}

void EndBaseCovariance(ceres::Covariance* covariance) {
  TheCovariances().Take(covariance);
  Next().EndBaseCovariance(covariance);
}

bool ComputePairs(ceres::Covariance* covariance, const ProblemCovariance::Pairs& pairs,
                  ceres::Problem* problem) {
  bool computed = false;
  return ComputeInsteadOfCeres(covariance, pairs, problem, &computed)
             ? computed
             : Next().ComputePairs(covariance, pairs, problem);
}

bool ComputeBlocks(ceres::Covariance* covariance, const std::vector<const double*>& blocks,
                   ceres::Problem* problem) {
  bool computed = false;
  return ComputeInsteadOfCeres(covariance, ProblemCovariance::AllPairs(blocks), problem, &computed)
             ? computed
             : Next().ComputeBlocks(covariance, blocks, problem);
}

bool GetBlock(const ceres::Covariance* covariance, const double* a, const double* b,
              double* block) {
  const ProblemCovariance* ours = TheCovariances().Computed(covariance);
  return ours != nullptr ? ours->GetBlock(a, b, /*ambient=*/true, block)
                         : Next().GetBlock(covariance, a, b, block);
}

bool GetTangentBlock(const ceres::Covariance* covariance, const double* a, const double* b,
                     double* block) {
  const ProblemCovariance* ours = TheCovariances().Computed(covariance);
  return ours != nullptr ? ours->GetBlock(a, b, /*ambient=*/false, block)
                         : Next().GetTangentBlock(covariance, a, b, block);
}

bool GetMatrix(const ceres::Covariance* covariance, const std::vector<const double*>& blocks,
               double* matrix) {
  const ProblemCovariance* ours = TheCovariances().Computed(covariance);
  return ours != nullptr ? ours->GetMatrix(blocks, /*ambient=*/true, matrix)
                         : Next().GetMatrix(covariance, blocks, matrix);
}

bool GetTangentMatrix(const ceres::Covariance* covariance, const std::vector<const double*>& blocks,
                      double* matrix) {
  const ProblemCovariance* ours = TheCovariances().Computed(covariance);
  return ours != nullptr ? ours->GetMatrix(blocks, /*ambient=*/false, matrix)
                         : Next().GetTangentMatrix(covariance, blocks, matrix);
}

}  // namespace inceres::internal::interposed

extern "C" {

int inceres_dropin_is_active(void) {
  return inceres::internal::interposed::IsActive() ? 1 : 0;
}

long long inceres_dropin_num_solves(void) {
  return inceres::internal::TheRegistry().num_solves();
}

int inceres_dropin_num_problems(void) {
  return inceres::internal::TheRegistry().size();
}

}  // extern "C"
