#pragma once

#include <optional>
#include <string>

#include "tools/fuzz/dice.h"
#include "tools/fuzz/judge.h"
#include "tools/fuzz/solver.h"
#include "tools/fuzz/world.h"

namespace inceres::fuzz {

/// A defect: what the solver under test did that it must not.
struct Finding {
  std::string kind;
  std::string detail;
  std::string iterations = {};  ///< of the solve; of stock and the judge where they were asked
};

/// Who says that a solve ended too high.
enum class Judges {
  kDescent,  ///< Judge alone
  kStock,    ///< and Ceres: started there, with the user's options, it gains kExcessTolerances
};

/// What was looked at; what was seen and let pass has a number of its own.
struct Counts {
  long edits = 0;
  long solves = 0;
  long handed_to_stock = 0;
  /// with a cause: a start that cannot be evaluated, a cost function that is faulty, or stock fails
  /// too
  long failures = 0;
  long not_converged = 0;  ///< a limit ended it, or it found no proof
  /// … it found no proof at the minimum, before its iterations were used up
  long unproven = 0;
  long judged = 0;    ///< ends from which plain LM was let go on
  long creeping = 0;  ///< … an excess in a valley too flat to hold it against anyone
  /// … an excess while a cost function is faulty, and stock's end has one too
  long beside_faults = 0;
  long as_stock = 0;         ///< … an excess in exact mode, and stock's end has one as large
  long unseen_by_stock = 0;  ///< … an excess that Ceres, started there, does not see either
  long traces_compared = 0;  ///< exact mode: iteration by iteration with stock
  long traces_chaotic = 0;   ///< … not compared: stock's own solvers do not agree
  double worst_creeping_excess = 0.0;  ///< in function tolerances
};

/// Solves the world's problem once and looks at all that a caller may rely on. The world is left
/// where the solver left it.
std::optional<Finding> SolveAndCheck(const ceres::Solver::Options& options, Judges judges,
                                     World* world, SolverUnderTest* solver, Dice* dice,
                                     Counts* counts);

}  // namespace inceres::fuzz
