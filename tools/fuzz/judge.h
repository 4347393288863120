#pragma once

#include <vector>

#include "tools/fuzz/world.h"

namespace inceres::fuzz {

/// Where plain Levenberg–Marquardt goes from a point. Costs are those of the residual blocks that
/// touch a variable block: next to that of the others they may be less than its last digit.
struct Verdict {
  bool judged = false;  ///< false: the point cannot be evaluated
  double cost = 0.0;    ///< at the point
  double best = 0.0;    ///< where it ends
  /// Accepted steps until it had gained kExcessTolerances, or all of them.
  int steps = 0;
  std::vector<double> costs;  ///< at the point and after each of its steps
  double excess = 0.0;        ///< (cost − best) / best
  /// above kExcessTolerances × tolerance × best, and above what rounding explains
  bool is_excess = false;
  /// an excess of which kCreepingSteps steps gained less than kExcessTolerances
  bool is_creeping = false;
  /// Of an excess: what the model promises at the point with dampings of 1e-4, 1e-6 … 1e-12.
  std::vector<double> promises;
};

/// How far above the minimum of its basin a solve may end, in units of its function tolerance.
constexpr double kExcessTolerances = 10.0;

/// Where so many steps of plain LM do not gain that much together, each gains less than a
/// tolerance: its own test for convergence, of one step's gain, would end there as well. Such ends
/// are counted, not condemned.
constexpr int kCreepingSteps = 15;

/// Descends from the world's values by dense LM that shares no code with any solver under test:
/// normal equations of ceres::Problem::Evaluate, solved by Eigen, damped by λ diag(H), λ from 1e-4.
/// The basin is that of the point by construction: a step is taken only if what it gains is between
/// a fourth and four times what the model promised; else λ grows, until steps are as short as the
/// model is good. It ends when a hardly damped step promises less than a thousandth of the
/// tolerance. Coordinates at a bound that the gradient pushes against stay there; others are
/// clamped.
///
/// Where the cost at the minimum is nearly zero, relative to it means nothing: with M what the cost
/// was if no term of any residual canceled another (World::MovingResidualBlocks), an excess below
/// 1e-18 M (nine digits of every residual), and what rounding makes of costs, 1e-13 √(M cost), is
/// none.
///
/// The world's values are as before when it returns. The faults of cost functions are in force: the
/// judge goes around them.
Verdict Judge(World* world, double function_tolerance);

}  // namespace inceres::fuzz
