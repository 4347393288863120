#include "inceres/solver/solver.h"

#include <algorithm>
#include <cstdlib>  // which says whose library it is
#include <limits>
#include <new>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

#include "base/executor.h"
#include "base/memory_budget.h"
#include "base/stopwatch.h"
#include "linearize/evaluator.h"
#include "linearize/jacobian_places.h"
#include "linearize/memory_prediction.h"
#include "linearize/variable_look_up.h"
#include "simd/kernels.h"
#include "trust_region/linear_model.h"
#include "trust_region/loop_options.h"
#include "trust_region/structure.h"
#include "trust_region/trust_region_minimizer.h"

#if defined(__GLIBC__)
#include <malloc.h>
#endif

namespace inceres {
namespace {

// The one place where the public solver meets its parts.
using namespace internal;  // NOLINT(google-build-using-namespace)

// A solve in the order of this file: options and graph are checked, a workspace is found or made,
// the trust-region loop runs in it, and the graph's values are written last, after everything that
// may fail or throw.
//
// The workspace is all that depends on the structure alone: layout, threads, evaluator with its
// plans, linear model with its symbolic factor, and the vectors of the loop. It outlives the solve
// if the caller keeps a Solver, and serves the next graph of equal structure (Structure), whichever
// object that is. Nothing of the old graph is read again after Rebind.

// Gives what was freed back to the system where the allocator keeps it, as glibc's does between
// blocks that are still in use. Takes milliseconds: for once a large solve.
void ReturnFreedMemory() {
#if defined(__GLIBC__)
  malloc_trim(0);
#endif
}

// Ceres's rule: the lowest cost seen, rejected candidates included; from the first iteration on
// whose cost is that of the factors as they are now.
double FinalCost(const Summary& summary, int first_iteration) {
  // Also where a resumed solve has no iteration 0 of its own.
  double cost = first_iteration == 0 ? summary.initial_cost : std::numeric_limits<double>::max();
  for (const IterationSummary& iteration : summary.iterations) {
    cost = iteration.iteration >= first_iteration ? std::min(cost, iteration.cost) : cost;
  }
  return cost;
}

// Nothing moves: the cost is that of the factors as they stand.
// The words are Ceres's.
void SummarizeStandstill(Evaluator* evaluator, Summary* summary) {
  double cost = 0.0;
  const Status evaluated = evaluator->EvaluateCandidateCost(&cost);
  if (!evaluated.ok()) {
    summary->message = "Residual and Jacobian evaluation failed.";
    summary->detail = evaluated.message;
    return;
  }
  summary->termination = Termination::kConvergence;
  summary->message = "Function tolerance reached. No non-constant parameter blocks found.";
  summary->initial_cost = summary->final_cost = cost;
}

// Of the whole graph; what moves is known once there is a layout.
ProblemSizes SizesOf(const FactorGraph& graph) {
  ProblemSizes sizes;
  sizes.num_variables = graph.num_live_variables();
  for (VariableId id = 0; id < graph.num_variables(); ++id) {
    // Ids of removed variables stay, without a variable.
    sizes.num_values += graph.HasVariable(id) ? graph.AmbientSize(id) : 0;
  }
  for (FamilyId id = 0; id < graph.num_families(); ++id) {
    // Places of removed factors are free, and not factors.
    const int count = graph.NumFactors(id) - graph.NumFreePlaces(id);
    sizes.num_factors += count;
    sizes.num_residuals += static_cast<std::int64_t>(count) * graph.family(id).residual_size();
  }
  return sizes;
}

void CountWhatMoves(const FactorGraph& graph, const Layout& layout, ProblemSizes* sizes) {
  sizes->num_moving_variables = static_cast<int>(layout.variables.size());
  sizes->num_dimensions = layout.size();
  for (const VariableId id : layout.variables) {
    sizes->num_moving_values += graph.AmbientSize(id);
  }
}

// Of the model, the strategy and the loop: gradient, diagonal, scale, the step and a shorter one,
// with its damping and what that holds back, or what a Dog-Leg takes; the step for a pass over J;
// and the best state.
std::int64_t VectorBytes(const SolverOptions& options, const Layout& layout,
                         const FactorGraph& graph) {
  const std::int64_t num_vectors = IsDamped(options.strategy) ? 7 : 12;
  return static_cast<std::int64_t>(sizeof(double)) *
         (num_vectors * layout.size() + std::int64_t{layout.quad_offset.back()} * kQuad +
          static_cast<std::int64_t>(graph.state().size()));
}

constexpr std::int64_t kMuchMemory = std::int64_t{1} << 26;  // 64 MiB

// Why Jacobians have to be kept; null where they can be evaluated anew for each pass instead:
// nobody but a factor of H or S reads them, and to evaluate once more means nothing to anybody.
const char* NeedsJacobians(const SolverOptions& options, const LoopOptions& loop,
                           const FactorGraph& graph) {
  if (IsIterative(options.linear_model) || options.linear_model == LinearModelKind::kDenseQr) {
    return "linear_model kDenseQr or an iterative one";
  }
  if (options.dynamic_sparsity || options.refine_landmarks || loop.inner_descent != nullptr) {
    return "dynamic_sparsity, or landmarks refined by themselves,";
  }
  if (options.observer != nullptr || loop.system_observer != nullptr) {
    return "an observer, who is told of each evaluation,";
  }
  return graph.HasBounds() ? "bounds" : JacobianChunks::Obstacle(graph);
}

// Of the options those that set-up depends on; tolerances, radii and strategies are of each solve.
auto KeyOf(const SolverOptions& options) {
  return std::tie(options.num_threads, options.linear_model, options.reduced_solver,
                  options.dynamic_sparsity, options.conjugate_gradients,
                  options.recompute_jacobians, options.max_memory_bytes);
}

// What a structure is set up with.
struct Workspace {
  Workspace(const SolverOptions& options, const LoopOptions& loop, const FactorGraph& graph,
            bool recomputes)
      : layout(graph, EliminatesLandmarks(options, loop)),
        executor(options.num_threads),
        key(KeyOf(options)),
        eliminated(EliminatedBy(loop)) {
    const JacobianStorage storage =
        recomputes ? JacobianStorage::kInChunks : StorageOf(options, loop, graph, layout);
    evaluator.emplace(graph, layout, executor, storage);
    // Whole rows of a dense model have no blocks to leave out.
    evaluator->set_leaves_out_zero_blocks(options.dynamic_sparsity &&
                                          storage == JacobianStorage::kBySlot);
  }

  // Coordinate descent ends where the next Jacobians are taken.
  void MakeRoomFor(const LoopOptions& loop) {
    if (loop.inner_descent != nullptr && !loop.inner_descent->asks_as_ceres) {
      evaluator->MakeRoomToKeep();
    }
  }

  // Whether factors are asked for more than passes over all of them.
  static bool NeedsTables(const SolverOptions& options, const LoopOptions& loop,
                          const FactorGraph& graph) {
    return loop.inner_descent != nullptr || options.refine_landmarks || graph.HasPins();
  }

  bool Recomputes() const { return evaluator->jacobian_chunks() != nullptr; }

  void SpareTables(MemoryBudget* budget) {
    const std::int64_t before = evaluator->Bytes();
    look_up.Bind(evaluator->graph(), evaluator->points());
    for (Linearization& family : evaluator->families()) {
      look_up.Serve(&family);
    }
    budget->GiveBack(before - evaluator->Bytes());
  }

  // Products with an S that is not formed read the Jacobians of a factor together. Nothing has been
  // written to the old ones yet.
  void StoreByFactor(const FactorGraph& graph, MemoryBudget* budget) {
    evaluator.reset();
    budget->GiveBack(budget->taken());
    TakeForGraph(graph, /*eliminates_landmarks=*/true, JacobianStorage::kByFactor, budget);
    evaluator.emplace(graph, layout, executor, JacobianStorage::kByFactor);
    evaluator->set_memory_budget(budget);
  }

  // The model, and Jacobians stored as it reads them.
  Status MakeModel(const SolverOptions& options, const LoopOptions& loop, const FactorGraph& graph,
                   MemoryBudget* budget) {
    // The other ways read Jacobians more often.
    std::unique_ptr<LandmarkIncidences> incidences;
    const StepWay way =
        Recomputes() ? StepWay::kFactor : ChooseStepWay(options, *evaluator, &incidences);
    if (way == StepWay::kBlocks || way == StepWay::kTwoLevel) {
      incidences.reset();
      StoreByFactor(graph, budget);
    }
    if (way == StepWay::kFactor && !NeedsTables(options, loop, graph) &&
        (Recomputes() || evaluator->storage() == JacobianStorage::kWithoutPadding)) {
      SpareTables(budget);
    }
    Status status;
    model =
        MakeLinearModel(options, way, *evaluator, loop.eliminated, std::move(incidences), &status);
    return status;
  }

  // A copy: LoopOptions are the caller's, and gone by the next solve.
  static std::vector<VariableId> EliminatedBy(const LoopOptions& loop) {
    return loop.eliminated != nullptr ? *loop.eliminated : std::vector<VariableId>();
  }

  // Models that solve for all variables at once take landmarks as frames. So does
  // LargeBlockSchurModel, which eliminates from the blocks of a whole H.
  static bool EliminatesLandmarks(const SolverOptions& options, const LoopOptions& loop) {
    const bool by_blocks = options.linear_model == LinearModelKind::kAutomatic ||
                           options.linear_model == LinearModelKind::kSchur ||
                           options.linear_model == LinearModelKind::kIterativeSchur;
    return by_blocks && !options.dynamic_sparsity && loop.eliminated == nullptr;
  }

  // Where S is not formed products with it read all of J: the less there is to read the better.
  // Where it is formed there is less to keep, if that is much.
  static JacobianStorage StorageAskedFor(const SolverOptions& options, const LoopOptions& loop,
                                         const FactorGraph& graph) {
    const ConjugateGradientsOptions& iteration = options.conjugate_gradients;
    if (options.linear_model != LinearModelKind::kIterativeSchur) {
      return EliminatesLandmarks(options, loop) && IsPaddingDear(graph)
                 ? JacobianStorage::kWithoutPadding
                 : JacobianStorage::kBySlot;
    }
    return iteration.single_precision_jacobians  ? JacobianStorage::kByFactorInSingle
           : iteration.explicit_schur_complement ? JacobianStorage::kBySlot
                                                 : JacobianStorage::kByFactor;
  }

  // A reduced solver that was asked for is given the blocks of its system.
  static JacobianStorage StorageOf(const SolverOptions& options, const LoopOptions& loop,
                                   const FactorGraph& graph, const Layout& layout) {
    const JacobianStorage asked = StorageAskedFor(options, loop, graph);
    if (asked != JacobianStorage::kBySlot) {
      return asked;
    }
    // Where none was asked for the small dense models are open, which have no reduced system.
    // One that is to eliminate in a certain order needs blocks, too.
    const bool free = options.reduced_solver == ReducedSolverKind::kAutomatic &&
                      !options.reduced_solver_factory && !IsIterative(options.linear_model) &&
                      !graph.HasEliminationGroups();
    return free ? StorageFor(graph, layout) : JacobianStorage::kBySlot;
  }

  bool Suits(const SolverOptions& options, const FactorGraph& graph) const {
    // A reduced solver that remembers what it solved, or that may, would take a second solve
    // another way than the first.
    const bool remembers = options.reduced_solver_factory ||
                           options.reduced_solver == ReducedSolverKind::kPcg ||
                           options.reduced_solver == ReducedSolverKind::kAutomaticInexact;
    // The comparison of structures is the dearest, and last.
    return !remembers && key == KeyOf(options) &&
           // Without a budget it recomputes where memory was short then, which it may not be now.
           (options.max_memory_bytes > 0 || options.recompute_jacobians || !Recomputes()) &&
           structure.has_value() && structure->IsThatOf(graph);
  }

  // taken when the first solve is over: who solves once does not pay for it
  std::optional<Structure> structure;
  Layout layout;
  Executor executor;
  // KeyOf, copied
  std::tuple<int, LinearModelKind, ReducedSolverKind, bool, ConjugateGradientsOptions, bool,
             std::int64_t>
      key;
  std::vector<VariableId> eliminated;  // LoopOptions::eliminated
  VariableLookUp look_up;              // unbound: families have tables
  std::optional<Evaluator> evaluator;
  // Refers to the evaluator, and is destroyed before it.
  std::unique_ptr<LinearModel> model;
  TrustRegionMemory memory;
  std::int64_t bytes = 0;  // of it all, counted while the graph was there
};

}  // namespace

struct Solver::Impl {
  void Solve(const SolverOptions& options, const LoopOptions& loop, FactorGraph* graph,
             Summary* summary);
  std::unique_ptr<Workspace> Prepare(const SolverOptions& options, const LoopOptions& loop,
                                     const FactorGraph& graph, Summary* summary);
  static std::unique_ptr<Workspace> SetUp(const SolverOptions& options, const LoopOptions& loop,
                                          const FactorGraph& graph, bool recomputes,
                                          Summary* summary);
  void SolveValid(const SolverOptions& options, LoopOptions loop, FactorGraph* graph,
                  Summary* summary, double start);

  std::int64_t max_bytes;  // to be held from solve to solve
  std::unique_ptr<Workspace> held;
};

// The old workspace, bound to the graph, or a new one; null, with the reason in the summary, if
// there is nothing to solve with.
// `held` is empty meanwhile: a solve that throws leaves nothing behind that is half of it.
std::unique_ptr<Workspace> Solver::Impl::Prepare(const SolverOptions& options,
                                                 const LoopOptions& loop, const FactorGraph& graph,
                                                 Summary* summary) {
  std::unique_ptr<Workspace> workspace = std::move(held);
  const char* const needs_jacobians = NeedsJacobians(options, loop, graph);
  // IsReadyFor has no LoopOptions: what they eliminate is compared here alone.
  summary->structure_reused =
      workspace != nullptr && workspace->Suits(options, graph) &&
      workspace->eliminated == Workspace::EliminatedBy(loop) &&
      !(workspace->look_up.is_bound() && Workspace::NeedsTables(options, loop, graph)) &&
      !(workspace->Recomputes() && needs_jacobians != nullptr);
  if (summary->structure_reused) {
    workspace->evaluator->Rebind(graph);
    if (workspace->look_up.is_bound()) {
      workspace->look_up.Bind(graph, workspace->evaluator->points());
    }
    workspace->MakeRoomFor(loop);
    return workspace;
  }
  workspace.reset();  // its memory serves the new one
  if (options.recompute_jacobians && needs_jacobians != nullptr) {
    summary->message = std::string("SolverOptions: recompute_jacobians does not go with ") +
                       needs_jacobians + " in this solve.";
    return nullptr;
  }
  try {
    return SetUp(options, loop, graph, options.recompute_jacobians, summary);
  } catch (const MemoryExceeded&) {
    if (options.recompute_jacobians || needs_jacobians != nullptr) {
      throw;
    }
  }
  return SetUp(options, loop, graph, /*recomputes=*/true, summary);
}

// Counted while it is set up, each thing before it is taken: what does not fit is told without
// having been tried.
std::unique_ptr<Workspace> Solver::Impl::SetUp(const SolverOptions& options,
                                               const LoopOptions& loop, const FactorGraph& graph,
                                               bool recomputes, Summary* summary) {
  MemoryBudget budget(options.max_memory_bytes);
  TakeForGraph(
      graph, Workspace::EliminatesLandmarks(options, loop),
      recomputes ? JacobianStorage::kInChunks : Workspace::StorageAskedFor(options, loop, graph),
      &budget);
  auto workspace = std::make_unique<Workspace>(options, loop, graph, recomputes);
  workspace->evaluator->set_memory_budget(&budget);
  // All variables are constant, or there are none. Ceres calls this converged.
  if (workspace->layout.variables.empty()) {
    SummarizeStandstill(&*workspace->evaluator, summary);
    return nullptr;
  }
  const Status status = workspace->MakeModel(options, loop, graph, &budget);
  if (!status.ok()) {
    summary->message = status.message;
    return nullptr;
  }
  workspace->evaluator->Take(VectorBytes(options, workspace->layout, graph),
                             "the vectors of a step");
  workspace->MakeRoomFor(loop);
  // What planning has freed would stay beside what the loop is about to fill.
  if (budget.taken() > kMuchMemory) {
    ReturnFreedMemory();
  }
  // The budget ends with this function; what is taken from now on was counted here.
  workspace->evaluator->set_memory_budget(nullptr);
  return workspace;
}

// Of valid options and a valid graph. May throw MemoryExceeded, bad_alloc, and what a factor
// throws.
void Solver::Impl::SolveValid(const SolverOptions& options, LoopOptions loop, FactorGraph* graph,
                              Summary* summary, double start) {
  std::unique_ptr<Workspace> workspace = Prepare(options, loop, *graph, summary);
  if (workspace == nullptr) {
    return;
  }
  // What is known before the first iteration goes into the summary first, so that it is there
  // however the loop ends.
  LinearModel& model = *workspace->model;
  summary->reduced_solver = model.SolverName();
  summary->recomputed_jacobians = workspace->Recomputes();
  summary->work.bytes = workspace->evaluator->Bytes();
  model.Describe(&summary->work);
  CountWhatMoves(*graph, workspace->layout, &summary->sizes);
  summary->seconds.setup = NowInSeconds() - start;

  // Set-up counts into the time limit, as in Ceres.
  loop.seconds_spent_before += summary->seconds.setup;
  TrustRegionMinimizer minimizer(options, loop, &*workspace->evaluator, &model, &workspace->memory,
                                 summary);
  minimizer.Minimize();
  if (options.dynamic_sparsity) {  // of which model and its solver are known by now
    WorkCounts found;
    model.Describe(&found);
    summary->reduced_solver = model.SolverName();
    summary->work.bytes = workspace->evaluator->Bytes() + found.bytes;
  }
  summary->final_cost = FinalCost(*summary, minimizer.first_comparable_iteration());
  // The only write to the graph. Where the solve has failed its values are as they were.
  if (summary->IsSolutionUsable()) {
    graph->mutable_state() = minimizer.best_state();
  }
  // A solver of max_bytes 0, as the free function makes it, never takes the structure of the graph.
  if (summary->work.bytes <= max_bytes) {
    // Of a workspace that was reused it is there already.
    if (!workspace->structure.has_value()) {
      workspace->structure.emplace(*graph);
    }
    workspace->bytes = summary->work.bytes + workspace->structure->Bytes();
    // Once more, with the structure itself.
    if (workspace->bytes <= max_bytes) {
      held = std::move(workspace);  // not if something was thrown on the way
    }
  }
}

void Solver::Impl::Solve(const SolverOptions& options, const LoopOptions& loop, FactorGraph* graph,
                         Summary* summary) {
  static const Summary& kBlank =
      *new Summary;  // never destroyed: a solve may come as late as another library's destructors
  const double start = NowInSeconds();
  *summary = kBlank;  // a copy, which keeps the memory of texts and iterations
  summary->kernels = BestKernels().name;
  summary->strategy = ToString(options.strategy);
  summary->num_threads = options.num_threads;
  summary->sizes = SizesOf(*graph);
  // Options first: they are cheap, and a graph is not.
  Status status = options.Validate();
  if (status.ok()) {
    status = graph->Validate();
  }
  try {
    if (status.ok()) {
      SolveValid(options, loop, graph, summary, start);
    } else {
      summary->message = status.message;
    }
  } catch (const MemoryExceeded& exceeded) {
    summary->termination = Termination::kFailure;
    summary->message = exceeded.message();
  } catch (const std::bad_alloc&) {
    // Neither is an error of the program: both come back as a summary.
    // The graph's state is written last, so it is untouched. What a user's factor throws is his and
    // passes through.
    summary->termination = Termination::kFailure;
    summary->message = "Out of memory.";
  }
  summary->seconds.total = NowInSeconds() - start;
}

Solver::Solver(std::int64_t max_bytes) : impl_(new Impl{max_bytes, nullptr}) {
}
Solver::~Solver() = default;
Solver::Solver(Solver&&) noexcept = default;
Solver& Solver::operator=(Solver&&) noexcept = default;

Summary Solver::Solve(const SolverOptions& options, FactorGraph* graph) {
  Summary summary;
  Solve(options, graph, &summary);
  return summary;
}

void Solver::Solve(const SolverOptions& options, FactorGraph* graph, Summary* summary) {
  impl_->Solve(options, internal::LoopOptions(), graph, summary);
}

// For those who solve for Ceres, or a batch phase for an Update.
void internal::SolveWith(const SolverOptions& options, const LoopOptions& loop, FactorGraph* graph,
                         Solver* solver, Summary* summary) {
  solver->impl_->Solve(options, loop, graph, summary);
}

// Whether a solve would be set up by what is held.
bool Solver::IsReadyFor(const SolverOptions& options, const FactorGraph& graph) const {
  return impl_->held != nullptr && impl_->held->Suits(options, graph);
}

std::int64_t Solver::Bytes() const {
  return impl_->held == nullptr ? 0 : impl_->held->bytes;
}

std::vector<VariableId> Solver::EliminationOrder() const {
  std::vector<VariableId> ids;
  if (impl_->held != nullptr) {
    for (const int frame : impl_->held->model->EliminationOrder()) {
      ids.push_back(impl_->held->layout.variables[frame]);
    }
  }
  return ids;
}

Summary Solve(const SolverOptions& options, FactorGraph* graph) {
  return Solver(/*max_bytes=*/0).Solve(options, graph);
}

}  // namespace inceres
