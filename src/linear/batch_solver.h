#pragma once

#include <string>
#include <utility>
#include <vector>

#include "inceres/linear/block_pattern.h"
#include "linear/incremental_reduced_solver.h"

namespace inceres::internal {

/// S as the solvers of the batch mode want it: a fixed pattern of the living rows, values in one piece. A held row keeps its
/// place in the pattern, with the values of the identity, so that holding and freeing variables costs no symbolic analysis.
class GatheredSystem {
 public:
  /// The pattern of the living rows. The values are all to be copied anew.
  void Analyze(const SymmetricBlockRows& S);
  /// Values; those of the rows before first_row are as they were, unless the pattern is new.
  void CopyValues(const SymmetricBlockRows& S, const double* damping, const char* held, int first_row);
  /// b with zeros in held rows, until the next call.
  const double* FreePart(const double* b);

  const BlockPattern& pattern() const { return pattern_; }
  const double* values() const { return values_.data(); }
  const double* diagonal() const { return diagonal_.data(); }
  std::size_t Bytes() const;

 private:
  void CopyRow(const SymmetricBlockRows& S, const double* damping, const char* held, int at);

  BlockPattern pattern_;
  std::vector<int> rows_;       // per block row of the pattern: its row in S
  std::vector<char> row_held_;  // per block row of the pattern
  std::vector<double> values_;
  std::vector<double> diagonal_;
  std::vector<double> b_;
  bool has_values_ = false;
};

/// A solver of the batch mode (DenseCholesky, SparseCholesky) on a living S: every Factorize is a whole one, but the symbolic
/// analysis is kept while the pattern stands.
template <typename Solver>
class BatchSolver final : public IncrementalReducedSolver {
 public:
  template <typename... Arguments>
  explicit BatchSolver(Arguments&&... arguments) : solver_(std::forward<Arguments>(arguments)...) {}

  const char* Name() const override { return solver_.Name(); }

  /// What Factorize does first when the pattern has changed; for who wants to know PredictedFlops before.
  Status Analyze(const SymmetricBlockRows& S) {
    system_.Analyze(S);
    analysed_ = system_.pattern().num_blocks() == 0 ? Status::Ok() : solver_.Analyze(system_.pattern());
    return analysed_;
  }
  double PredictedFlops() const { return solver_.PredictedFlops(); }

  Status Factorize(const SymmetricBlockRows& S, const double* damping, const char* held, const Change& change) override {
    work_ = Work();
    factored_ = change.pattern || !analysed_.ok() ? Analyze(S) : Status::Ok();
    if (factored_.ok() && system_.pattern().num_blocks() > 0) {
      system_.CopyValues(S, damping, held, change.first_row);
      work_.factored_rows = system_.pattern().num_blocks();
      work_.factor_flops = solver_.PredictedFlops();
      factored_ = solver_.Factorize(system_.values(), system_.diagonal());
    }
    return factored_;
  }

  Status Solve(const double* b, const Rows& /*changed_b*/, const Truncation& /*truncation*/, double* x) override {
    if (!factored_.ok() || system_.pattern().num_blocks() == 0) {
      return factored_;
    }
    work_.forward_rows = work_.solved_rows = system_.pattern().num_blocks();
    return solver_.Solve(system_.FreePart(b), x);
  }

  std::size_t Bytes() const override { return system_.Bytes() + solver_.Bytes(); }

 private:
  Solver solver_;
  GatheredSystem system_;
  Status analysed_ = Status::Error(StatusCode::kInvalidArgument, "not analyzed yet");
  Status factored_ = Status::Error(StatusCode::kInvalidArgument, "not factored yet");
};

}  // namespace inceres::internal
