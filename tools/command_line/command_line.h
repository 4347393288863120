#pragma once

#include <functional>
#include <initializer_list>
#include <optional>
#include <string>
#include <utility>

#include "inceres/status.h"
#include "tools/command_line/help.h"

namespace inceres::tools {

/// Exit codes of the tools: docs/tools.md.
enum ExitCode {
  kExitSuccess = 0,
  kExitFailure = 1,    ///< a file could not be read or written, a problem not solved
  kExitUsage = 2,      ///< a flag or argument makes no sense
  kExitWorse = 3,      ///< ab_compare: our final cost is above the best stock run's
  kExitUsedStock = 4,  ///< ab_compare, covariance_compare: stock Ceres would have to do it
};

/// Parses the command line with gflags. Returns the exit code if the program is to end now: after
/// --help, --version, a flag that is unknown or whose value cannot be read, a surplus argument, or
/// flags of the output that contradict each other.
std::optional<int> ParseCommandLine(const ToolHelp& help, int* argc, char*** argv);

/// What main() returns of a tool that does one thing: parses the command line, runs, and says what
/// went wrong; an invalid argument is a usage error. `unavailable` is the code for kUnavailable.
int RunTool(const ToolHelp& help, int argc, char** argv, const std::function<Status()>& run,
            ExitCode unavailable = kExitFailure);

/// What a flag that makes no sense is: kInvalidArgument.
Status Invalid(const std::string& message);

/// Whether the folders of the files that the command line has written take them: to be asked before
/// work that may take an hour, not after it. An error (kIo) names the flag.
Status CheckFoldersToWrite();

/// Whether the command line set this flag to something else than its default.
bool IsSet(const char* flag);

/// What a flag's word stands for, of those known; another is Invalid, and the message has them.
template <typename Value>
Status Choose(const std::string& flag, const std::string& word,
              std::initializer_list<std::pair<const char*, Value>> known, Value* chosen) {
  std::string words;
  for (const auto& [name, value] : known) {
    if (word == name) {
      *chosen = value;
      return Status::Ok();
    }
    words += (words.empty() ? "" : ", ") + std::string(name);
  }
  return Invalid(flag + " '" + word + "': use one of " + words);
}

/// A flag, and the least it may be.
struct IntegerFlag {
  const char* name;
  int value;
  int least;
};

/// The first flag that is below its least value, or a tolerance that is not a finite number of at
/// least 0, as Invalid.
Status CheckNumbers(std::initializer_list<IntegerFlag> integers,
                    std::initializer_list<std::pair<const char*, double>> tolerances);

/// Prints "tool: message" on standard error and returns `code`.
int Fail(ExitCode code, const std::string& message);

}  // namespace inceres::tools
