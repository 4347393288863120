#pragma once

#include <memory>

#include "linear/eigen_ldlt_solver.h"

namespace inceres::test {

/// A user's own solver that counts its calls, and misbehaves on request.
class CountingSolver final : public ReducedSolver {
 public:
  struct Record {
    int num_made = 0;
    int num_analyses = 0;
    int num_factorizations = 0;
    int num_solves = 0;
    int num_changed_rows = 0;  // it was told of at the last factorization
    Status analysis;
    Status factorization;
  };
  explicit CountingSolver(Record* record) : record_(*record) { ++record_.num_made; }
  const char* Name() const override { return "counting"; }
  Status Analyze(const ReducedMatrix& A) override {
    ++record_.num_analyses;
    return record_.analysis.ok() ? solver_.Analyze(A) : record_.analysis;
  }
  Status Factorize(const ReducedMatrix& A, const Rows& changed) override {
    ++record_.num_factorizations;
    record_.num_changed_rows =
        changed.rows != nullptr ? static_cast<int>(changed.rows->size()) : A.pattern().num_blocks();
    return record_.factorization.ok() ? solver_.Factorize(A, changed) : record_.factorization;
  }
  Status Solve(const double* b, const Rows& changed_b, const Truncation& truncation,
               double* x) override {
    ++record_.num_solves;
    return solver_.Solve(b, changed_b, truncation, x);
  }

 private:
  Record& record_;
  EigenLdltSolver solver_;
};

inline ReducedSolverFactory MakesCountingSolvers(CountingSolver::Record* record) {
  return [record] { return std::make_unique<CountingSolver>(record); };
}

}  // namespace inceres::test
