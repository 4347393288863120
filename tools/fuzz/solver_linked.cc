// The solvers of a program that calls inceres by name.
#include "inceres/ceres/session.h"
#include "inceres/ceres/solve.h"
#include "tools/fuzz/solver.h"

namespace inceres::fuzz {
namespace {

class OneShot : public SolverUnderTest {
 public:
  explicit OneShot(SolveMode mode) { options_.mode = mode; }
  void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
             ceres::Solver::Summary* summary) override {
    inceres::Solve(options, problem, summary, options_, &report_);
  }
  void Reset() override { ForgetStructures(); }
  bool follows_stock() const override { return options_.mode == SolveMode::kExact; }
  bool repeats() const override { return true; }
  bool used_stock() const override { return report_.used_stock; }

 private:
  SolveOptions options_;
  SolveReport report_;
};

class Session : public SolverUnderTest {
 public:
  void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
             ceres::Solver::Summary* summary) override {
    session_.Solve(options, problem, summary, SolveOptions(), &report_);
  }
  void Reset() override { session_.Reset(); }
  bool follows_stock() const override { return false; }
  bool used_stock() const override { return report_.used_stock; }

 private:
  static SessionOptions AlwaysIncremental() {
    SessionOptions options;
    options.exact_windows = false;  // these problems are small, and exact solves are another mode's
    return options;
  }

  CeresSession session_{AlwaysIncremental()};
  SolveReport report_;
};

class Stock : public SolverUnderTest {
 public:
  void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
             ceres::Solver::Summary* summary) override {
    SolveByStock(options, problem, summary);
  }
  bool follows_stock() const override { return false; }  // it is judged as others are
};

}  // namespace

std::vector<std::string> Modes() {
  return {"exact", "incremental", "session", kStockMode};
}

std::unique_ptr<SolverUnderTest> MakeSolver(const std::string& mode) {
  if (mode == kStockMode) {
    return std::make_unique<Stock>();
  }
  if (mode == "session") {
    return std::make_unique<Session>();
  }
  return std::make_unique<OneShot>(mode == "exact" ? SolveMode::kExact : SolveMode::kIncremental);
}

void SolveByStock(const ceres::Solver::Options& options, ceres::Problem* problem,
                  ceres::Solver::Summary* summary) {
  ceres::Solve(options, problem, summary);
}

}  // namespace inceres::fuzz
