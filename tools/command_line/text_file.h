#pragma once

#include <string>

#include "inceres/status.h"

namespace inceres::tools {

/// Writes `text` to `path`, all or an error (kIo) that names the path and the system's reason.
/// `how` is fopen's: "w", or "a" to append.
Status WriteTextFile(const std::string& path, const std::string& text, const char* how = "w");

}  // namespace inceres::tools
