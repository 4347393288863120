#include "dropin/run_program.h"

#include <cstdio>

#include <sys/wait.h>

#include "support/temp_dir.h"

namespace inceres::testing {

ProgramRun RunProgram(const std::string& program, const std::string& arguments,
                      const std::string& environment) {
  const test::TempDir folder;
  const std::string errors = folder.File("stderr");
  // A preloaded library with a sanitizer's runtime comes before the program's own: that is what we
  // want here.
  const std::string command = "env ASAN_OPTIONS=$ASAN_OPTIONS:verify_asan_link_order=0 " +
                              environment + " '" + program + "' " + arguments + " 2> '" + errors +
                              "'";
  ProgramRun run;
  std::FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) {
    run.err = "cannot run " + command;
    return run;
  }
  char buffer[4096];
  for (std::size_t count; (count = std::fread(buffer, 1, sizeof(buffer), pipe)) > 0;) {
    run.out.append(buffer, count);
  }
  const int status = pclose(pipe);
  run.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;

  run.err = test::ReadBytes(errors);
  return run;
}

}  // namespace inceres::testing
