#pragma once

#include <string>

#include "inceres/status.h"

namespace inceres::tools {

/// Whether --json asks for a report.
bool WantsJson();

/// Writes the report, a text of JSON without the last line break, to where --json says: a file, or
/// for "-" standard output. Without --json it does nothing. An error (kIo) names the file.
Status WriteJsonReport(const std::string& json);

/// The same, but a file keeps the lines it has and gets one more.
Status AppendJsonReport(const std::string& json);

}  // namespace inceres::tools
