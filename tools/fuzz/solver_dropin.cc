// The solver of a program that knows nothing of inceres and is linked to the drop-in in Ceres's
// place.
#include <dlfcn.h>

#include <cstdio>
#include <cstdlib>

#include "tools/fuzz/solver.h"

namespace inceres::fuzz {
namespace {

// ceres::Solver::Solve as a function of its object, which it is in the Itanium C++ ABI.
using SolverSolve = void (*)(ceres::Solver*, const ceres::Solver::Options&, ceres::Problem*,
                             ceres::Solver::Summary*);

class CeresAsLinked : public SolverUnderTest {
 public:
  CeresAsLinked(bool follows_stock, bool may_follow_stock)
      : follows_stock_(follows_stock), may_follow_stock_(may_follow_stock) {}
  void Solve(const ceres::Solver::Options& options, ceres::Problem* problem,
             ceres::Solver::Summary* summary) override {
    ceres::Solve(options, problem, summary);
  }
  bool follows_stock() const override { return follows_stock_; }
  bool may_follow_stock() const override { return may_follow_stock_; }

 private:
  bool follows_stock_;
  bool may_follow_stock_;
};

// The one of the Ceres library itself: a lookup that begins there does not see the drop-in in front
// of it.
SolverSolve StockSolverSolve() {
  void* ceres = dlopen(INCERES_CERES_SONAME, RTLD_LAZY | RTLD_NOLOAD);
  const char* const symbol = "_ZN5ceres6Solver5SolveERKNS0_7OptionsEPNS_7ProblemEPNS0_7SummaryE";
  void* const solve = ceres != nullptr ? dlsym(ceres, symbol) : nullptr;
  if (solve == nullptr) {
    std::fprintf(stderr, "differential_fuzzer_dropin: no %s in %s\n", symbol, INCERES_CERES_SONAME);
    std::exit(2);
  }
  return reinterpret_cast<SolverSolve>(solve);
}

}  // namespace

std::vector<std::string> Modes() {
  const char* const mode = std::getenv("INCERES_MODE");
  const std::string name = mode != nullptr ? mode : "exact";
  return {name == "exact" ? "dropin" : name == "incremental" ? "dropin_incremental" : name};
}

std::unique_ptr<SolverUnderTest> MakeSolver(const std::string& mode) {
  return std::make_unique<CeresAsLinked>(mode == "dropin", mode != "dropin_incremental");
}

void SolveByStock(const ceres::Solver::Options& options, ceres::Problem* problem,
                  ceres::Solver::Summary* summary) {
  static const SolverSolve kSolve = StockSolverSolve();
  ceres::Solver solver;
  kSolve(&solver, options, problem, summary);
}

}  // namespace inceres::fuzz
