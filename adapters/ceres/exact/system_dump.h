#pragma once

#include <string>
#include <vector>

#include <ceres/solver.h>

#include "adapters/ceres/plan/graph_plan.h"
#include "adapters/ceres/read/introspection.h"
#include "src/trust_region/loop_options.h"

namespace inceres::internal {

/// What trust_region_minimizer_iterations_to_dump asks for: the linear system min ‖A x − b‖² +
/// ‖D x‖² of these iterations in files, or in the log, as Ceres writes them: A the scaled Jacobian,
/// b the residuals, D the damping, x the step of Levenberg–Marquardt or the solution of Dog-Leg's
/// linear solve.
///
/// Rows are in the order of the residual blocks in the problem; columns in the order in which
/// blocks appear in them, those that a Schur type eliminates first. Ceres has them in an order of
/// its own, which depends on its linear solver. A file that cannot be written is an error in the
/// log; the solve goes on.
class SystemDump : public StepSystemObserver {
 public:
  /// Keeps numbers only, nothing of the view. `type`: the effective linear solver.
  SystemDump(const ceres::Solver::Options& options, const ProblemView& view, const GraphPlan& plan,
             ceres::LinearSolverType type);

  bool Wants(int iteration) const override;
  void See(const StepSystem& system) override;

 private:
  /// What is written; sparse entries block by block.
  struct Entry {
    int row;
    int column;
    double value;
  };

  std::vector<Entry> JacobianOf(const StepSystem& system) const;
  std::vector<Entry> AllEntries(const std::vector<Entry>& entries) const;
  std::vector<double> ResidualsOf(const StepSystem& system) const;
  template <typename Scale>
  std::vector<double> InColumnOrder(const StepSystem& system, const std::vector<double>& values,
                                    const Scale& scale) const;
  void WriteToLog(const std::vector<Entry>& A, const std::vector<double>& D,
                  const std::vector<double>& b, const std::vector<double>& x) const;
  bool WriteFiles(const std::string& base, const std::vector<Entry>& A,
                  const std::vector<double>& D, const std::vector<double>& b,
                  const std::vector<double>& x) const;

  std::vector<int> iterations_;  // ascending
  std::string directory_;
  bool to_log_;
  bool dense_;
  bool leaves_out_zeros_;  // of A, as dynamic_sparsity does in Ceres
  int num_rows_ = 0;
  int num_columns_ = 0;
  std::vector<std::vector<int>> first_row_;  // per family and factor
  std::vector<int> num_rows_of_;             // a factor, per family
  std::vector<int> first_column_;            // per VariableId; -1: of a constant
  struct Columns {
    VariableId variable;
    int count;
  };
  std::vector<Columns> columns_;  // in their order
};

}  // namespace inceres::internal
