#include "tools/command_line/output.h"

#include <unistd.h>

#include <gflags/gflags.h>

#include "tools/command_line/command_line.h"

DEFINE_bool(quiet, false,
            "Print nothing where all goes well; files that were asked for are written.");
DEFINE_string(progress, "auto",
              "Tell on standard error, once a second, how far work is that takes more than one: "
              "always, never, or auto: if that is a terminal.");

namespace inceres::tools {
namespace {

// Not every program has a flag --json.
bool JsonTakesStandardOutput() {
  std::string path;
  return gflags::GetCommandLineOption("json", &path) && path == "-";
}

std::FILE* Nowhere() {
  static std::FILE* const kNowhere = std::fopen("/dev/null", "w");
  return kNowhere;
}

}  // namespace

std::FILE* Out() {
  return FLAGS_quiet || JsonTakesStandardOutput() ? Nowhere() : stdout;
}

void PrintLine(const std::string& line) {
  std::fprintf(Out(), "%s\n", line.c_str());
  std::fflush(Out());
}

std::FILE* ProgressOutput() {
  const bool wanted =
      FLAGS_progress == "always" || (FLAGS_progress == "auto" && isatty(STDERR_FILENO) == 1);
  return wanted && !FLAGS_quiet ? stderr : nullptr;
}

std::FILE* ProgressOutputBesideTable() {
  const bool seen = Out() == stdout && isatty(STDOUT_FILENO) == 1;
  return seen && FLAGS_progress == "auto" ? nullptr : ProgressOutput();
}

Status ApplyOutputFlags() {
  if (FLAGS_progress != "auto" && FLAGS_progress != "always" && FLAGS_progress != "never") {
    return Invalid("--progress '" + FLAGS_progress + "': use auto, always or never");
  }
  if (FLAGS_quiet && FLAGS_progress == "always") {
    return Invalid("--quiet and --progress always contradict each other");
  }
  if (FLAGS_quiet) {  // no such flag, no effect: not every program has glog's
    gflags::SetCommandLineOptionWithMode("minloglevel", "2", gflags::SET_FLAG_IF_DEFAULT);
  }
  return Status::Ok();
}

}  // namespace inceres::tools
