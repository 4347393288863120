#pragma once

#include <cstdio>
#include <string>

#include "inceres/status.h"

namespace inceres::tools {

/// Where a tool prints what it tells people: standard output; nowhere with --quiet, and with
/// --json -, when standard output is for JSON alone.
std::FILE* Out();

/// Prints the line there at once.
void PrintLine(const std::string& line);

/// Where progress is told: standard error, or null for nowhere. By --progress: always, never, or
/// auto, on a terminal. Never with --quiet.
std::FILE* ProgressOutput();

/// The same for work whose table grows on standard output meanwhile: null as well where auto finds
/// that table on a terminal.
std::FILE* ProgressOutputBesideTable();

/// Ok if --progress is one of its words and does not contradict --quiet; else kInvalidArgument.
/// With --quiet the libraries' warnings are off as well, unless the command line sets
/// --minloglevel.
Status ApplyOutputFlags();

}  // namespace inceres::tools
