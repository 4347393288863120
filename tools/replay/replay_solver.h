#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <ceres/types.h>

#include "inceres/solver/incremental_solver.h"
#include "inceres/status.h"
#include "tools/replay/replay_step.h"

namespace inceres::tools {

/// What one step's solve did.
struct ReplayOutcome {
  bool usable = false;      ///< false: the state is what it was
  std::string termination;  ///< "CONVERGENCE", "NO_CONVERGENCE", …
  std::string message;      ///< why, when not usable
  double seconds = 0.0;     ///< the solve call alone
  /// the same of processor time, all threads together; the runner sets it. What other programs do
  /// at the time is no part of it
  double processor_seconds = 0.0;
  double initial_cost = -1.0;
  double final_cost = -1.0;                                ///< as the solver reports it
  int iterations = 0;                                      ///< steps tried, accepted or not
  std::vector<std::pair<std::string, std::int64_t>> work;  ///< counts of work, by name
};

/// One side of a replay: keeps a problem that grows, and solves it again, warm, after each step.
class ReplaySolver {
 public:
  virtual ~ReplaySolver() = default;

  /// "stock Ceres, dense_schur, dogleg".
  virtual std::string Name() const = 0;

  /// Adds the step's variables and factors to the living problem. Not part of a step's latency; the
  /// runner times it apart.
  virtual Status AddStep(const ReplayStep& step) = 0;

  /// Solves from the current state. A solve that fails is an outcome that is not usable.
  virtual ReplayOutcome Solve() = 0;

  /// The ambient values of all variables so far, one after the other in order of arrival.
  virtual std::vector<double> State() const = 0;

  /// Moves all variables to values like those of State(). False where a solver goes on from its own
  /// state only.
  virtual bool StartFrom(const std::vector<double>& /*state*/) { return false; }

  /// The reduced system of the solver that remembers; of the others nothing.
  virtual std::optional<ReducedStructure> Structure() const { return std::nullopt; }
};

/// How every side solves.
struct ReplaySettings {
  bool autodiff = false;  ///< AutoDiff cost functions; else the analytic factors
  bool dogleg = false;    ///< else Levenberg–Marquardt
  /// of stock Ceres; Schur solvers have landmarks first
  ceres::LinearSolverType linear_solver = ceres::DENSE_SCHUR;
  int num_threads = 1;
  int max_num_iterations = 50;
  double function_tolerance = 1e-6;
  double gradient_tolerance = 1e-10;
  double parameter_tolerance = 1e-8;
  /// The solver that remembers is asked for covariances after each Update, which the step's seconds
  /// do not count.
  bool covariance = false;
  bool gnc = false;  ///< the solver that remembers finds wrong loops by LivingGnc
};

/// Stock Ceres with the linear solver of the settings, for a problem that grows: a Schur solver
/// where there are landmarks.
std::unique_ptr<ReplaySolver> MakeStockReplaySolver(const ReplaySettings& settings);

/// Ours in exact mode: the core's batch solver on the analytic factors, or the shim on AutoDiff
/// cost functions.
std::unique_ptr<ReplaySolver> MakeExactReplaySolver(const ReplaySettings& settings);

/// The core's IncrementalSolver on a factor graph of analytic factors or AutoDiff cost functions.
/// Levenberg–Marquardt in its own metric, whatever the settings say of the strategy.
std::unique_ptr<ReplaySolver> MakeIncrementalReplaySolver(const ReplaySettings& settings);

/// The judge: the same problem in stock Ceres. Evaluates any state, and finds the minimum that
/// stock Levenberg–Marquardt reaches from it at tolerances of 1e-12.
class ReplayReference {
 public:
  explicit ReplayReference(const ReplaySettings& settings);
  ~ReplayReference();
  Status AddStep(const ReplayStep& step);
  /// ½ Σ ρ(‖f‖²); not finite if it cannot be evaluated.
  double CostAt(const std::vector<double>& state);
  ReplayOutcome MinimumFrom(const std::vector<double>& state);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace inceres::tools
