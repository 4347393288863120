#include "inceres/distributed/distributed_solver.h"

#include <algorithm>
#include <exception>
#include <optional>
#include <utility>

#include "base/executor.h"
#include "base/stopwatch.h"
#include "distributed/checkpoint_keeper.h"
#include "distributed/communicator.h"
#include "distributed/distributed_model.h"
#include "distributed/petsc_objects.h"
#include "distributed/shared_frames.h"
#include "distributed/solve_steps.h"
#include "linearize/evaluator.h"
#include "simd/kernels.h"
#include "trust_region/loop_options.h"
#include "trust_region/trust_region_minimizer.h"

namespace inceres {

// The batch solver on several ranks: set-up, the trust-region loop of one process with Communicator
// as its Agreement, and the way back into the graphs (docs/distributed.md).
//
// Everything here is collective. Each step of set-up ends in a Status that is the same on all
// ranks, so they return together; in the loop they part only by AgreedFailure, which all throw. An
// exception of another kind is known to one rank alone, while the others wait for it in some
// exchange: it ends the program.
//
// A graph is written after the loop, by TakeOver, and by nothing before; so on failure all graphs
// are as they were.

namespace {

// The one place where the public solver meets its parts.
using namespace internal;  // NOLINT(google-build-using-namespace)

// What one rank can say of its part by itself; SharedFrames compares the parts.
Status CheckPart(const GraphPart& part) {
  if (part.graph == nullptr) {
    return Status::Error(StatusCode::kInvalidArgument, "GraphPart::graph is null");
  }
  if (part.graph->HasEliminationGroups()) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "variables with elimination groups: the distributed solver orders by "
                         "itself");
  }
  if (part.graph->HasBounds()) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "variables with bounds: the distributed solver has none");
  }
  if (part.graph->HasPins()) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "pinned variables: the distributed solver has none");
  }
  return part.graph->Validate();
}

// Up to here the factor of S is small even if S is full: 2,000³ / 3 flops, 16 MB of its half. Whole
// solves on one rank, by user time: on collections of photos of 100, 200 and 300 cameras, 900 to
// 2,700 unknowns, MUMPS took 0.81, 0.99 and 0.98 of what conjugate gradients with blocks of S took;
// in cities, whose S is sparse, less far beyond.
constexpr std::int64_t kMaxUnknownsToFactor = 2000;

// What kAutomatic stands for.
DistributedOptions Resolved(DistributedOptions options, std::int64_t num_unknowns) {
  if (options.linear_solver == DistributedLinearSolver::kAutomatic) {
    options.linear_solver = num_unknowns <= kMaxUnknownsToFactor
                                ? DistributedLinearSolver::kCholesky
                                : DistributedLinearSolver::kConjugateGradients;
  }
  return options;
}

// What a part is solved with, set up on all ranks together.
// Members refer to those above them, hence the order, and the optional ones: they are made when
// what they need has been agreed on.
struct Workspace {
  Workspace(const DistributedOptions& options, const Communicator& ranks, const GraphPart& part)
      : layout(*part.graph, /*eliminate_landmarks=*/true), executor(options.solver.num_threads) {
    status = frames.Agree(ranks, part, layout);
  }

  Layout layout;
  Executor executor;
  // Which frames the ranks have in common; `status` is of that.
  SharedFrames frames;
  Status status;
  std::optional<Evaluator> evaluator;
  std::unique_ptr<DistributedModel> model;
  bool is_iterative = false;
  TrustRegionMemory memory;
};

}  // namespace

class DistributedSolver::Impl {
 public:
  // PETSc first: it starts MPI where nobody has, and the communicator is duplicated afterwards.
  Impl(MPI_Comm comm, DistributedOptions options)
      : ranks_((EnsurePetsc(), comm)), options_(std::move(options)) {}

  DistributedSummary Solve(const GraphPart& part);

 private:
  Status SetUp(const GraphPart& part, std::unique_ptr<Workspace>* workspace, Summary* summary);
  void Minimize(const GraphPart& part, Workspace* workspace, double start,
                DistributedSummary* summary);
  void TakeOver(const GraphPart& part, const std::vector<double>& state, Workspace* workspace);
  void SolveAgreed(const GraphPart& part, double start, DistributedSummary* summary);

  Communicator ranks_;
  const DistributedOptions options_;
};

// From the cheap to the dear: options, each part by itself, the frames of all, the evaluator, the
// model. Each is agreed on before the next, since the next relies on it; options come first, since
// they decide which collective calls there are.
Status DistributedSolver::Impl::SetUp(const GraphPart& part, std::unique_ptr<Workspace>* workspace,
                                      Summary* summary) {
  Status status = AgreeOnOptions(ranks_, options_);
  status = status.ok() ? ranks_.Try([&] { return CheckPart(part); }) : status;
  if (!status.ok()) {
    return status;
  }
  *workspace = std::make_unique<Workspace>(options_, ranks_, part);
  Workspace& work = **workspace;
  if (!work.status.ok()) {
    return work.status;
  }
  // Frames begin the layout, so this is a list by position. Norms and dot products skip what others
  // count.
  std::vector<char> elsewhere;
  for (const FramePlace& place : work.frames.moving()) {
    elsewhere.push_back(place.owner == ranks_.rank() ? 0 : 1);
  }
  ranks_.LetOthersCount(std::move(elsewhere));
  status = ranks_.Try([&] {
    work.evaluator.emplace(*part.graph, work.layout, work.executor);
    return Status::Ok();
  });
  if (status.ok()) {
    // Refers to the workspace; Solve takes it back.
    ranks_.FindThrowersBy([&work] { return DescribeThrower(&*work.evaluator); });
    // kAutomatic looks at the unknowns of all ranks, the same number on each.
    const DistributedOptions resolved =
        Resolved(options_, work.frames.total_size(FramePlace::kTangent));
    work.is_iterative = resolved.linear_solver != DistributedLinearSolver::kCholesky;
    // What kAutomatic stands for may not go with the other options.
    status = ranks_.Agree(resolved.Validate());
    if (!status.ok()) {
      return status;
    }
    work.model =
        std::make_unique<DistributedModel>(resolved, ranks_, work.frames, *work.evaluator, &status);
  }
  if (status.ok()) {
    summary->reduced_solver = work.model->SolverName();
    summary->work.bytes = work.evaluator->Bytes();
    work.model->Describe(&summary->work);
    SumSizes(ranks_, *part.graph, work.layout, work.frames, &summary->sizes);
  }
  return status;
}

// The values of frames are the same wherever they are listed; of those that no factor here touches
// they are fetched from their owners.
void DistributedSolver::Impl::TakeOver(const GraphPart& part, const std::vector<double>& state,
                                       Workspace* workspace) {
  FactorGraph& graph = *part.graph;
  graph.mutable_state() = state;
  const SharedFrames& frames = workspace->frames;
  // Planned for this one exchange. Frames that factors here touch have been moved by the loop on
  // this rank too, with the same steps.
  FrameExchange values(ranks_, frames, frames.idle(), FramePlace::kAmbient);
  std::vector<double> owned;
  for (const int position : frames.owned()) {
    const FramePlace& place = frames.moving()[static_cast<std::size_t>(position)];
    const double* const x = graph.Values(place.variable);
    owned.insert(owned.end(), x, x + place.sizes[FramePlace::kAmbient]);
  }
  std::vector<double> here(static_cast<std::size_t>(values.here_size()));
  values.Spread(owned.data(), here.data());
  const double* next = here.data();
  for (const FramePlace& place : frames.idle()) {
    graph.SetValues(place.variable, next);
    next += place.sizes[FramePlace::kAmbient];
  }
}

// Runs the loop, from the values of the graph or from a checkpoint. `start` is when Solve began:
// the time of set-up counts for the limit.
void DistributedSolver::Impl::Minimize(const GraphPart& part, Workspace* workspace, double start,
                                       DistributedSummary* summary) {
  Summary& solve = summary->solve;
  solve.seconds.setup = NowInSeconds() - start;
  LoopOptions loop;
  loop.seconds_spent_before = solve.seconds.setup;
  loop.agreement = &ranks_;
  CheckpointKeeper keeper(options_, ranks_, part, workspace->frames, workspace->layout);
  LoopPosition position;
  if (!options_.checkpoint.resume.empty()) {
    // A copy: a file that is refused leaves the graph alone.
    std::vector<double> state = part.graph->state();
    const Status resumed = keeper.Resume(&position, &state);
    if (!resumed.ok()) {
      summary->solve.message = resumed.message;
      return;
    }
    workspace->evaluator->points().SetCurrent(state);
    loop.resume = &position;
  }
  // Without a path it wants nothing.
  loop.keeper = &keeper;
  TrustRegionMinimizer minimizer(options_.solver, loop, &*workspace->evaluator,
                                 workspace->model.get(), &workspace->memory, &solve);
  minimizer.Minimize();
  // The least cost that is of the function as it is now: factors that move their expansion points
  // change it. Of non-monotonic steps the last cost need not be the least.
  solve.final_cost = solve.initial_cost;
  for (const IterationSummary& iteration : solve.iterations) {
    if (iteration.iteration >= minimizer.first_comparable_iteration()) {
      solve.final_cost = std::min(solve.final_cost, iteration.cost);
    }
    // A factorization counts as one iteration in its summary, but is none of conjugate gradients.
    if (workspace->is_iterative) {
      solve.work.num_conjugate_gradients += iteration.linear_solver_iterations;
    }
  }
  summary->num_checkpoints = keeper.num_written();
  summary->checkpoint_failure = keeper.failure();
  if (solve.IsSolutionUsable()) {
    TakeOver(part, minimizer.best_state(), workspace);
  }
}

// Whatever returns early returns on all ranks with the same message. The reports at the end are
// gathered, so every rank has those of all.
void DistributedSolver::Impl::SolveAgreed(const GraphPart& part, double start,
                                          DistributedSummary* summary) {
  std::unique_ptr<Workspace> workspace;
  Summary& solve = summary->solve;
  const Status status = SetUp(part, &workspace, &solve);
  if (!status.ok()) {
    solve.message = status.message;
    return;
  }
  // Set-up is not counted.
  const TrafficCounter traffic(ranks_);
  // Of all ranks: one without anything to move takes part where others have something.
  if (solve.sizes.num_moving_variables > 0) {
    Minimize(part, workspace.get(), start, summary);
  } else {
    double cost = 0.0;
    // Nothing moves anywhere: the cost of the start, and the message of Ceres.
    const Status evaluated = ranks_.Evaluate(
        [&](double* own) { return workspace->evaluator->EvaluateCandidateCost(own); }, &cost);
    solve.termination = evaluated.ok() ? Termination::kConvergence : Termination::kFailure;
    solve.message = evaluated.ok()
                        ? "Function tolerance reached. No non-constant parameter blocks found."
                        : "Residual and Jacobian evaluation failed.";
    solve.detail = evaluated.message;
    solve.initial_cost = solve.final_cost = evaluated.ok() ? cost : -1.0;
  }
  RankReport own =
      traffic.Report(*part.graph, workspace->layout, workspace->frames, *workspace->model);
  own.bytes = solve.work.bytes;
  own.seconds = NowInSeconds() - start;
  GatherReports(ranks_, own, summary);
}

// An agreed failure is a summary; any other exception ends the program, for nobody else knows of
// it.
DistributedSummary DistributedSolver::Impl::Solve(const GraphPart& part) {
  DistributedSummary summary;
  Summary& solve = summary.solve;
  const double start = NowInSeconds();
  solve.kernels = BestKernels().name;
  solve.strategy = ToString(options_.solver.strategy);
  solve.num_threads = options_.solver.num_threads;
  try {
    SolveAgreed(part, start, &summary);
  } catch (const AgreedFailure& failure) {
    solve.termination = Termination::kFailure;
    solve.message = failure.status().message;
  } catch (const std::exception& exception) {
    // Nobody else knows of it, and all wait for this rank.
    ForgetPetsc();
    ranks_.Abort(exception.what());
  } catch (...) {
    ForgetPetsc();
    ranks_.Abort("something was thrown that is no std::exception");
  }
  // What it refers to is gone.
  ranks_.FindThrowersBy(nullptr);
  solve.seconds.total = NowInSeconds() - start;
  return summary;
}

DistributedSolver::DistributedSolver(MPI_Comm comm, DistributedOptions options)
    : impl_(std::make_unique<Impl>(comm, std::move(options))) {
}

DistributedSolver::~DistributedSolver() = default;

DistributedSummary DistributedSolver::Solve(const GraphPart& part) {
  return impl_->Solve(part);
}

}  // namespace inceres
