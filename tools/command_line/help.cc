#include "tools/command_line/help.h"

#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <sstream>

#include <gflags/gflags.h>

namespace inceres::tools {
namespace {

constexpr std::size_t kColumns = 80;

// Every tool has these; where they are defined tells them from its own.
constexpr char kCommonFlags[] = "tools/command_line/output.cc";

constexpr std::pair<int, const char*> kCommonExitCodes[] = {
    {0, "success"},
    {1, "failure: a file could not be read or written, a problem not be solved"},
    {2, "usage: a flag or its value makes no sense"}};

// The paragraphs of a text, each wrapped, all lines indented.
std::string Wrapped(const std::string& text, std::size_t indent) {
  const std::string margin(indent, ' ');
  std::string wrapped;
  std::istringstream paragraphs(text);
  for (std::string paragraph; std::getline(paragraphs, paragraph);) {
    std::istringstream words(paragraph);
    std::string line;
    for (std::string word; words >> word;) {
      if (!line.empty() && indent + line.size() + 1 + word.size() > kColumns) {
        wrapped += margin + line + "\n";
        line.clear();
      }
      line += (line.empty() ? "" : " ") + word;
    }
    wrapped += line.empty() ? "\n" : margin + line + "\n";
  }
  return wrapped;
}

std::string DefaultOf(const gflags::CommandLineFlagInfo& flag) {
  if (flag.default_value.empty()) {
    return "none";
  }
  if (flag.type != "double") {
    return flag.default_value;
  }
  char shortest[32];
  std::snprintf(shortest, sizeof(shortest), "%g", std::strtod(flag.default_value.c_str(), nullptr));
  return shortest;
}

// gflags' own --help also lists the flags of every library; a stranger wants ours.
std::string FlagsText(bool common) {
  std::vector<gflags::CommandLineFlagInfo> flags;
  gflags::GetAllFlags(&flags);
  std::string text;
  for (const gflags::CommandLineFlagInfo& flag : flags) {
    const bool is_common = flag.filename.find(kCommonFlags) != std::string::npos;
    if (flag.filename.find("tools/") != std::string::npos && is_common == common) {
      text += "  --" + flag.name + " (" + flag.type + "; default: " + DefaultOf(flag) + ")\n" +
              Wrapped(flag.description, 6);
    }
  }
  return text;
}

std::string ExitCodesText(const ToolHelp& help) {
  std::string text;
  for (const auto& [code, meaning] : kCommonExitCodes) {
    text += "  " + std::to_string(code) + "  " + meaning + "\n";
  }
  for (const auto& [code, meaning] : help.exit_codes) {
    text += "  " + std::to_string(code) + "  " + meaning + "\n";
  }
  return text;
}

}  // namespace

std::string HelpText(const std::string& tool, const ToolHelp& help) {
  std::string text = "Usage: " + tool + " [OPTION]...\n" + Wrapped(help.summary, 0);
  if (*help.details != '\0') {
    text += "\n" + Wrapped(help.details, 0);
  }
  text += "\nExamples:";
  for (const ToolExample& example : help.examples) {
    text += "\n  # " + std::string(example.purpose) + "\n  " + example.command + "\n";
  }
  return text + "\nOptions:\n" + FlagsText(false) + "\nOptions of every tool:\n" + FlagsText(true) +
         "  --help\n      Print this and exit.\n"
         "  --version\n      Print the version and exit.\n"
         "\nExit codes:\n" +
         ExitCodesText(help);
}

std::string VersionText(const std::string& tool) {
  return tool +
         " (inceres) " INCERES_TOOLS_VERSION
         "\n\nLicense: BSD-3-Clause. There is no warranty, to the extent permitted by law.\n";
}

}  // namespace inceres::tools
