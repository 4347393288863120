#pragma once

#include <string>

#include "inceres/solver/solver.h"
#include "inceres/solver/summary.h"

namespace inceres::internal {

/// Whether an observer lets a solve go on. If not, the solve ends like this, in Ceres's words.
inline bool GoesOn(ObserverAction action, Termination* termination, std::string* message) {
  switch (action) {
    case ObserverAction::kTerminateSuccessfully:
      *termination = Termination::kUserSuccess;
      *message = "User callback returned SOLVER_TERMINATE_SUCCESSFULLY.";
      return false;
    case ObserverAction::kAbort:
      *termination = Termination::kUserFailure;
      *message = "User callback returned SOLVER_ABORT.";
      return false;
    case ObserverAction::kContinue:
      break;
  }
  return true;
}

}  // namespace inceres::internal
