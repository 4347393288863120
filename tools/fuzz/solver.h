#pragma once

#include <memory>
#include <string>
#include <vector>

#include <ceres/problem.h>
#include <ceres/solver.h>

namespace inceres::fuzz {

/// A way to solve that is under test. One object serves the whole life of a problem.
class SolverUnderTest {
 public:
  SolverUnderTest() = default;
  virtual ~SolverUnderTest() = default;
  SolverUnderTest(const SolverUnderTest&) = delete;
  SolverUnderTest& operator=(const SolverUnderTest&) = delete;

  virtual void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
                     ceres::Solver::Summary* summary) = 0;
  /// Forgets what it remembers, where there is a way to ask for that.
  virtual void Reset() {}
  /// Whether it promises Ceres's trace.
  virtual bool follows_stock() const = 0;
  /// Whether it may choose to follow stock: then it may end as far above the minimum as stock does.
  virtual bool may_follow_stock() const { return follows_stock(); }
  /// Whether each solve stands for itself: the same problem again gives the same bits, with any
  /// number of threads.
  virtual bool repeats() const { return false; }
  /// Whether the last solve was handed to stock Ceres, as far as it tells.
  virtual bool used_stock() const { return false; }
};

/// Stock Ceres under test, for comparison: what the judge makes of it.
constexpr char kStockMode[] = "stock";
/// The modes this program has: exact, incremental, session and kStockMode, or with the drop-in in
/// front of Ceres the one that INCERES_MODE says: dropin, dropin_incremental or auto.
std::vector<std::string> Modes();
/// `mode` is one of Modes().
std::unique_ptr<SolverUnderTest> MakeSolver(const std::string& mode);

/// Stock Ceres, past everything of ours.
void SolveByStock(const ceres::Solver::Options& options, ceres::Problem* problem,
                  ceres::Solver::Summary* summary);

}  // namespace inceres::fuzz
