#pragma once

#include <string>

#include <ceres/iteration_callback.h>
#include <ceres/solver.h>

#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/plan/solve_input.h"
#include "adapters/ceres/read/introspection.h"
#include "adapters/ceres/read/ordering.h"
#include "inceres/solver/summary.h"

namespace inceres::internal {

/// One line of the trace in Ceres's type. `eta` is the option's: reported where Ceres has not
/// solved for a good step.
ceres::IterationSummary ToCeres(const IterationSummary& iteration, double eta);

/// What Ceres writes before it preprocesses: copies of the options, sizes of the whole problem.
void WriteGiven(const ceres::Solver::Options& options, const ProblemView& view,
                ceres::Solver::Summary* summary);

/// Costs, iterations, termination, counts and times of a solve by the core. `eta` as above.
void WriteSolution(double eta, const Summary& core, ceres::Solver::Summary* summary);

/// The result of a problem in which nothing can move, where preprocessing ends.
void WriteNothingToSolve(const SolveInput& input, double fixed_cost,
                         ceres::Solver::Summary* summary);

/// Sizes of the reduced problem, unless preprocessing failed, and the times of the end of a solve.
void WriteEnd(const SolveInput& input, bool preprocessed, ceres::Solver::Summary* summary);

/// Linear solver used, its Schur structure, and the groups of the elimination.
void WriteLinearSolver(const ProblemView& view, const OrderingView& ordering,
                       const LandmarkSelection& landmarks, ceres::LinearSolverType type,
                       ceres::Solver::Summary* summary);

/// As Ceres's warning of a step that could not be evaluated, which a logging_type of SILENT
/// suppresses; but once a solve, and with what was at fault. Nothing if `failed_step` is empty.
void LogFailedStep(ceres::LoggingType logging_type, const std::string& failed_step);

/// `summary` tells of the second part of a solve, numbered on from the first
/// (SolveInput::last_iteration): makes it tell of both.
void Prepend(const ceres::Solver::Summary& first, ceres::Solver::Summary* summary);

}  // namespace inceres::internal
