#include "tools/command_line/command_line.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include <gflags/gflags.h>

DECLARE_bool(help);
DECLARE_bool(helpshort);

namespace inceres::tools {
namespace {

// gflags' own --help also lists the flags of every library; a stranger wants ours.
void PrintHelp(const std::string& usage) {
  std::printf("%s: %s\n\nFlags:\n", gflags::ProgramInvocationShortName(), usage.c_str());
  std::vector<gflags::CommandLineFlagInfo> flags;
  gflags::GetAllFlags(&flags);
  for (const gflags::CommandLineFlagInfo& flag : flags) {
    if (flag.filename.find("tools/") == std::string::npos) {
      continue;
    }
    std::string default_value = flag.default_value.empty() ? "none" : flag.default_value;
    if (flag.type == "double") {
      char shortest[32];
      std::snprintf(shortest, sizeof(shortest), "%g", std::strtod(default_value.c_str(), nullptr));
      default_value = shortest;
    }
    std::printf("  --%s (%s; default: %s)\n      %s\n", flag.name.c_str(), flag.type.c_str(),
                default_value.c_str(), flag.description.c_str());
  }
}

}  // namespace

std::optional<int> ParseCommandLine(const std::string& usage, int* argc, char*** argv) {
  gflags::SetUsageMessage(usage);
  gflags::ParseCommandLineNonHelpFlags(argc, argv, true);
  if (FLAGS_help || FLAGS_helpshort) {
    PrintHelp(usage);
    return kExitSuccess;
  }
  gflags::HandleCommandLineHelpFlags();
  if (*argc > 1) {
    return Fail(kExitUsage, "surplus argument '" + std::string((*argv)[1]) +
                                "'; all inputs are flags, see --help");
  }
  return std::nullopt;
}

int RunTool(const std::string& usage, int argc, char** argv, const std::function<Status()>& run) {
  if (const std::optional<int> exit_code = ParseCommandLine(usage, &argc, &argv)) {
    return *exit_code;
  }
  const Status status = run();
  if (!status.ok()) {
    return Fail(status.code == StatusCode::kInvalidArgument ? kExitUsage : kExitFailure,
                status.message);
  }
  return kExitSuccess;
}

Status Invalid(const std::string& message) {
  return Status::Error(StatusCode::kInvalidArgument, message);
}

bool IsSet(const char* flag) {
  return !gflags::GetCommandLineFlagInfoOrDie(flag).is_default;
}

Status CheckNumbers(std::initializer_list<IntegerFlag> integers,
                    std::initializer_list<std::pair<const char*, double>> tolerances) {
  for (const auto& [name, value, least] : integers) {
    if (value < least) {
      return Invalid(std::string(name) + " " + std::to_string(value) + ": must be at least " +
                     std::to_string(least));
    }
  }
  for (const auto& [name, value] : tolerances) {
    if (!std::isfinite(value) || value < 0.0) {
      return Invalid(std::string(name) + " " + std::to_string(value) +
                     ": must be a finite number, at least 0");
    }
  }
  return Status::Ok();
}

int Fail(ExitCode code, const std::string& message) {
  std::fflush(stdout);
  std::fprintf(stderr, "%s: %s\n", gflags::ProgramInvocationShortName(), message.c_str());
  return code;
}

}  // namespace inceres::tools
