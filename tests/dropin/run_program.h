#pragma once

#include <string>

namespace inceres::testing {

struct ProgramRun {
  int exit_code = -1;
  std::string out;
  std::string err;
};

/// Runs a program with its arguments; `environment` is a list like "A=1 B=2", without blanks or
/// quotes in its values.
ProgramRun RunProgram(const std::string& program, const std::string& arguments,
                      const std::string& environment);

}  // namespace inceres::testing
