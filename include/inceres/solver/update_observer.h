#pragma once

#include "inceres/export.h"
#include "inceres/solver/solver.h"
#include "inceres/solver/update_summary.h"

namespace inceres {

/// Looks on while an IncrementalSolver works, and may stop it. What SolveObserver is to the batch solver.
class INCERES_EXPORT UpdateObserver {
 public:
  virtual ~UpdateObserver() = default;

  /// At the end of iteration 0, which is the start, and of every later one, on the thread that called Update; not of the one that
  /// finds out that nothing is left to do. IncrementalSolver::Values() then gives the best state so far; nothing else of the
  /// solver may be called but RequestStop(). kTerminateSuccessfully ends the Update with that state, kAbort with the values held
  /// before it.
  virtual ObserverAction EndOfIteration(const UpdateIteration& iteration) = 0;
};

}  // namespace inceres
