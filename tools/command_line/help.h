#pragma once

#include <string>
#include <utility>
#include <vector>

namespace inceres::tools {

/// A command that one can paste, and what it is for.
struct ToolExample {
  const char* purpose;
  const char* command;
};

/// What --help says of a tool besides its flags. Paragraphs are lines; they are wrapped for the
/// reader.
struct ToolHelp {
  const char* summary;  ///< what it does, in one sentence: also the head of its man page
  const char* details;  ///< paragraphs, one a line; may be empty
  std::vector<ToolExample> examples;
  std::vector<std::pair<int, const char*>> exit_codes = {};  ///< those that not every tool has
};

/// The text of --help: usage, examples, the flags of this project (not of the libraries it links),
/// exit codes; in lines of at most 80 columns, in the form that help2man makes a man page of.
std::string HelpText(const std::string& tool, const ToolHelp& help);

/// The text of --version: "TOOL (inceres) 0.1.0" and the license.
std::string VersionText(const std::string& tool);

}  // namespace inceres::tools
