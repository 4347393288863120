#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tools/fuzz/trace.h"
#include "tools/fuzz/trial.h"

namespace inceres::fuzz {

/// One solve and the checks of it, in trial.cc (memory, calls, costs) and trial_end.cc (how and
/// where it ended).
class Trial {
 public:
  Trial(const ceres::Solver::Options& options, Judges judges, World* world, SolverUnderTest* solver,
        Dice* dice, Counts* counts)
      : options_(options),
        judges_(judges),
        world_(world),
        solver_(solver),
        dice_(dice),
        counts_(counts),
        start_(world->Values()) {}

  std::optional<Finding> Run();

 private:
  using Check = std::optional<Finding> (Trial::*)();

  void LookAtStart();
  double Rounding(double cost) const;
  bool SaysAsStock(double cost, double rounding);

  std::optional<Finding> Calls();
  std::optional<Finding> Memory();
  std::optional<Finding> Bounds();
  std::optional<Finding> Costs();
  std::optional<Finding> Termination();
  std::optional<Finding> CheckLimit();
  std::optional<Finding> Trace();
  std::optional<Finding> Repetition();
  std::optional<Finding> End();
  std::optional<Finding> CheckExcess(const Verdict& ours);
  const StockTraces& Stock();
  Verdict VerdictOn(const StockTraces& stock);

  const ceres::Solver::Options& options_;
  const Judges judges_;
  World* world_;
  SolverUnderTest* solver_;
  Dice* dice_;
  Counts* counts_;
  std::vector<double> start_;
  bool start_has_cost_ = false;   // which is finite
  bool start_evaluates_ = false;  // cost and Jacobians

  double start_cost_ = 0.0;
  Verdict judge_;  // of an excess: where it goes on from there
  ceres::Solver::Summary summary_;
  std::unique_ptr<StockTraces> stock_;
};

}  // namespace inceres::fuzz
