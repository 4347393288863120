#pragma once

#include <string>

namespace inceres::internal {

/// How the drop-in treats a solve. INCERES_MODE names them without the k, in lower case.
enum class DropinMode {
  kExact,        ///< inceres::SolveMode::kExact
  kIncremental,  ///< incremental wherever it can, exact where it cannot
  kAuto,         ///< incremental for what lives on and changes little (IsIncremental has the rule), else exact
  kStock,        ///< nothing is looked at
};

/// What the user asks of the drop-in, all of it by environment variables.
struct Environment {
  DropinMode mode = DropinMode::kExact;
};

/// Read at the first call, then the same for good: every variable of the drop-in is read here and nowhere else. A value that
/// means nothing is said once in the log and has no effect. Threads: any.
const Environment& TheEnvironment();

/// Sets the mode that the text of INCERES_MODE names (null: not set, so kExact). False if it names none: `mode` is as it was.
bool ParseMode(const char* text, DropinMode* mode);

const char* ModeName(DropinMode mode);

}  // namespace inceres::internal
