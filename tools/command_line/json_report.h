#pragma once

#include <nlohmann/json_fwd.hpp>

#include "inceres/status.h"

namespace inceres::tools {

/// Whether --json asks for a report.
bool WantsJson();

/// Writes the report to where --json says: a file, or for "-" standard output. Without --json it
/// does nothing. Bytes that are not UTF-8, as a file's name may have, become U+FFFD, and numbers
/// that are not finite null. An error (kIo) names the file.
Status WriteJsonReport(const nlohmann::json& report);

/// The same on one line; a file keeps those it has.
Status AppendJsonReport(const nlohmann::json& report);

}  // namespace inceres::tools
