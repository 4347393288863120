#include "tools/command_line/command_line.h"

#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <vector>

#include <gflags/gflags.h>

#include "tools/command_line/output.h"

DECLARE_bool(help);
DECLARE_bool(helpshort);
DECLARE_bool(version);

namespace inceres::tools {
namespace {

// Whether a word of the command line that names no flag is --noFLAG.
bool IsNegation(const std::string& name) {
  gflags::CommandLineFlagInfo flag;
  return name.rfind("no", 0) == 0 &&
         gflags::GetCommandLineFlagInfo(name.substr(2).c_str(), &flag) && flag.type == "bool";
}

// gflags ends the process with code 1 where a flag is unknown or its value cannot be read; here
// those are usage errors like any other, and found before gflags looks.
Status CheckArguments(int argc, char** argv) {
  for (int i = 1; i < argc && std::strcmp(argv[i], "--") != 0; ++i) {
    const std::string argument = argv[i];
    if (argument.size() < 2 || argument[0] != '-') {
      continue;  // surplus: ParseCommandLine tells
    }
    const std::size_t equals = argument.find('=');
    const std::size_t dashes = argument[1] == '-' ? 2 : 1;
    const std::string name = argument.substr(dashes, equals - dashes);
    gflags::CommandLineFlagInfo flag;
    if (!gflags::GetCommandLineFlagInfo(name.c_str(), &flag)) {
      if (equals == std::string::npos && IsNegation(name)) {
        continue;
      }
      return Invalid("unknown command line flag '" + name + "'; see --help");
    }
    if (equals == std::string::npos && flag.type == "bool") {
      continue;
    }
    if (equals == std::string::npos && ++i == argc) {
      return Invalid("flag '--" + name + "' is missing its value");
    }
    const std::string value = equals == std::string::npos ? argv[i] : argument.substr(equals + 1);
    if (gflags::SetCommandLineOption(name.c_str(), value.c_str()).empty()) {
      return Invalid("illegal value '" + value + "' specified for " + flag.type + " flag '" + name +
                     "'");
    }
  }
  return Status::Ok();
}

// The files that are to be written, each after its flag.
std::vector<std::pair<std::string, std::string>> FilesToWrite() {
  std::vector<std::pair<std::string, std::string>> files;
  for (const char* name : {"output", "truth", "picture", "json"}) {
    std::string file;
    if (gflags::GetCommandLineOption(name, &file) && !file.empty() && file != "-" &&
        file.rfind("/dev/", 0) != 0) {
      files.emplace_back(name, file);
    }
  }
  return files;
}

// Two files of one name: the one written last would be all that is left.
Status CheckFilesToWrite() {
  const auto files = FilesToWrite();
  for (std::size_t i = 0; i < files.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (files[i].second == files[j].second) {
        return Invalid("--" + files[j].first + " and --" + files[i].first + " name the same file");
      }
    }
  }
  return Status::Ok();
}

}  // namespace

std::optional<int> ParseCommandLine(const ToolHelp& help, int* argc, char*** argv) {
  gflags::SetArgv(*argc, const_cast<const char**>(*argv));
  if (const Status status = CheckArguments(*argc, *argv); !status.ok()) {
    return Fail(kExitUsage, status.message);
  }
  gflags::ParseCommandLineNonHelpFlags(argc, argv, true);
  const std::string tool = gflags::ProgramInvocationShortName();
  if (FLAGS_help || FLAGS_helpshort || FLAGS_version) {
    std::fputs((FLAGS_version ? VersionText(tool) : HelpText(tool, help)).c_str(), stdout);
    return std::fflush(stdout) == 0 ? kExitSuccess : kExitFailure;
  }
  gflags::SetUsageMessage(help.summary);
  gflags::HandleCommandLineHelpFlags();
  if (*argc > 1) {
    return Fail(kExitUsage, "surplus argument '" + std::string((*argv)[1]) +
                                "'; all inputs are flags, see --help");
  }
  Status status = CheckFilesToWrite();
  status = status.ok() ? ApplyOutputFlags() : status;
  return status.ok() ? std::nullopt : std::optional<int>(Fail(kExitUsage, status.message));
}

int RunTool(const ToolHelp& help, int argc, char** argv, const std::function<Status()>& run,
            ExitCode unavailable) {
  if (const std::optional<int> exit_code = ParseCommandLine(help, &argc, &argv)) {
    return *exit_code;
  }
  Status status = CheckFoldersToWrite();
  status = status.ok() ? run() : status;
  if (!status.ok()) {
    return Fail(status.code == StatusCode::kInvalidArgument ? kExitUsage
                : status.code == StatusCode::kUnavailable   ? unavailable
                                                            : kExitFailure,
                status.message);
  }
  return kExitSuccess;
}

Status Invalid(const std::string& message) {
  return Status::Error(StatusCode::kInvalidArgument, message);
}

Status CheckFoldersToWrite() {
  for (const auto& [name, file] : FilesToWrite()) {
    const std::filesystem::path folder = std::filesystem::path(file).parent_path();
    if (access(file.c_str(), W_OK) != 0 &&
        access(folder.empty() ? "." : folder.c_str(), W_OK) != 0) {
      return Status::Error(
          StatusCode::kIo,
          "--" + name + " " + file + ": cannot write into its folder: " + std::strerror(errno));
    }
  }
  return Status::Ok();
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
