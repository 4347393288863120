#pragma once

#include <functional>
#include <string>
#include <vector>

#include "inceres/ceres/solve.h"

namespace inceres::internal {

/// How the drop-in treats a solve. INCERES_MODE names them without the k, in lower case.
enum class DropinMode {
  kExact,        ///< inceres::SolveMode::kExact
  kIncremental,  ///< incremental wherever it can, exact where it cannot
  kAuto,      ///< as kIncremental, and exact while that takes less work (SessionOptions::automatic)
  kFallback,  ///< looked at as in exact mode, then handed to stock Ceres whatever it is
  kStock,     ///< nothing is looked at
};

const char* ModeName(DropinMode mode);

/// What the variables that begin with INCERES_ ask for. Every one is read here and nowhere else;
/// OptionsFromEnvironment lists them.
struct Environment {
  DropinMode mode = DropinMode::kExact;
  bool exact_windows = true;  ///< SessionOptions::exact_windows of the drop-in's sessions
  CrossCheckOptions cross_check;
  std::string ab_log;
  std::vector<std::string> complaints;  ///< one for each value that means nothing and is ignored
};

/// `variable` gives a variable's value or null, as std::getenv does.
Environment ReadEnvironment(const std::function<const char*(const char*)>& variable);

/// That of this process: read at the first call, then the same for good. Complaints go to the log,
/// once. Threads: any.
const Environment& TheEnvironment();

}  // namespace inceres::internal
