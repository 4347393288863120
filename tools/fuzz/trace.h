#pragma once

#include <optional>
#include <string>
#include <vector>

#include <ceres/solver.h>

#include "tools/fuzz/dice.h"
#include "tools/fuzz/world.h"

namespace inceres::fuzz {

/// How stock Ceres solves from some values: by the user's linear solver, by another one, and from
/// values next to these. Where the three agree there is a trace to follow.
class StockTraces {
 public:
  /// The world's values are as before when it returns.
  StockTraces(const ceres::Solver::Options& options, const std::vector<double>& start, World* world,
              Dice* dice);

  /// Whether rounding decides nothing: same termination, as many iterations, costs within 1e-8, as
  /// long as they are more than rounding.
  bool agree() const { return agree_; }
  /// What is different in `ours`, if anything: termination, number of iterations, which of them
  /// were accepted, or a cost by more than 1e-6 and a hundred times what stock's differ by; as long
  /// as costs are more than rounding.
  std::optional<std::string> Difference(const ceres::Solver::Summary& ours) const;

  /// Whether all three converge in fewer iterations: otherwise it is a matter of luck.
  bool Converge(int num_iterations) const { return num_iterations_ < num_iterations; }

  /// Whether stock ended by its gradient or parameter tolerance, which tell nothing of the cost.
  bool EndedByLength() const;
  const ceres::Solver::Summary& summary() const { return summary_; }
  const std::vector<double>& end() const { return end_; }

 private:
  double Distance(const ceres::Solver::Summary& other) const;
  bool IsRounding(double cost) const;
  void Count(const ceres::Solver::Summary& one);

  ceres::Solver::Summary summary_;
  std::vector<double> end_;
  double floor_ = 0.0;  // costs that differ by less are equal
  bool agree_ = false;
  double distance_ = 0.0;   // among stock's
  int num_iterations_ = 0;  // the most that one of the three took to converge
};

}  // namespace inceres::fuzz
