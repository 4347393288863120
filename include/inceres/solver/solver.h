#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "inceres/export.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/solver/callbacks.h"
#include "inceres/solver/options.h"
#include "inceres/solver/summary.h"

namespace inceres {

class Solver;
namespace internal {
struct LoopOptions;
void SolveWith(const SolverOptions& options, const LoopOptions& loop, FactorGraph* graph,
               Solver* solver, Summary* summary);
}  // namespace internal

/// The hooks of the trust-region loop, in Ceres's order (docs/ceres_contract.md, "Trust-region
/// loop"): an observer sees every evaluation before it happens and every iteration after it ended.
/// All calls come from the solving thread. State vectors are laid out like FactorGraph::state().
class INCERES_EXPORT SolveObserver {
 public:
  virtual ~SolveObserver() = default;

  /// Before residuals (and Jacobians, if `jacobians`) are evaluated at `state`. `new_point` is
  /// false only when Jacobians are asked for at the accepted candidate whose cost is already known.
  virtual void BeforeEvaluation(const double* /*state*/, bool /*jacobians*/, bool /*new_point*/) {}

  /// At the end of iteration 0 and of every completed iteration; `best_state` is what a stop here
  /// would return.
  virtual ObserverAction EndOfIteration(const IterationSummary& /*summary*/,
                                        const double* /*best_state*/) {
    return ObserverAction::kContinue;
  }
};

/// Minimizes the graph's cost, that of factors whose variables are all constant included; on a
/// usable solution the graph's state is the best one found, otherwise it is untouched. The summary
/// names what happened.
///
/// Cost: each iteration is linear in factors and block products plus the factorization of the
/// reduced system. Threads: up to options.num_threads; the result is the same to the last bit for
/// any number. Source: Ceres 2.1's trust-region minimizer, without its scaling of J.
INCERES_EXPORT Summary Solve(const SolverOptions& options, FactorGraph* graph);

/// The batch solver for who solves again and again: problems of one structure, the same graph or
/// another one, find layout, elimination order, symbolic factorization, arrays and threads ready.
/// Structure is compared by content (sizes, roles, constants, connections, which families prepare
/// or recenter), never by address, and no number computed for one solve is used in the next: the
/// result is that of Solve, to the last bit. Summary::structure_reused tells. A graph of another
/// structure, another number of threads, linear model or reduced solver is set up anew, and what
/// was there is given back; so it is each time with a reduced_solver_factory, kPcg and
/// kAutomaticInexact.
///
/// Between solves only the solver's own arrays are held (Bytes); of the graph nothing is touched
/// any more. Threads: one solve at a time.
class INCERES_EXPORT Solver {
 public:
  /// Holds nothing from one solve to the next where that would take more than max_bytes.
  explicit Solver(std::int64_t max_bytes = std::numeric_limits<std::int64_t>::max());
  ~Solver();
  /// Takes over what the other one holds.
  Solver(Solver&&) noexcept;
  /// Takes over what the other one holds.
  Solver& operator=(Solver&&) noexcept;

  /// As the free function.
  Summary Solve(const SolverOptions& options, FactorGraph* graph);

  /// The same into a summary that has served before, whose memory is used again: a solve that finds
  /// its structure ready then asks for no memory at all (LM or traditional Dog-Leg; what the
  /// graph's families and observers do is theirs). Exempt, because rare and set up anew each time:
  /// what Solver says, dynamic_sparsity, dense QR, the subspace Dog-Leg, inner iterations, line
  /// searches along bounds, and the text of an error.
  void Solve(const SolverOptions& options, FactorGraph* graph, Summary* summary);

  /// Whether a solve with these options would find its structure ready. Cost: a comparison, up to
  /// the first difference.
  bool IsReadyFor(const SolverOptions& options, const FactorGraph& graph) const;

  /// What is held from solve to solve.
  std::int64_t Bytes() const;

  /// The frames of the structure that is held, in the order in which its Cholesky factor eliminates
  /// them: of two that it couples that of the lower group first (FactorGraph::SetEliminationGroup).
  /// Landmarks go before them all. Empty where nothing is held, and where steps come without such a
  /// factor: by conjugate gradients, QR, dynamic_sparsity, a reduced_solver_factory, or a small
  /// dense matrix that has no blocks. Cost: a pass over the frames.
  std::vector<VariableId> EliminationOrder() const;

 private:
  friend void internal::SolveWith(const SolverOptions& options, const internal::LoopOptions& loop,
                                  FactorGraph* graph, Solver* solver, Summary* summary);
  struct INCERES_HIDDEN Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace inceres
