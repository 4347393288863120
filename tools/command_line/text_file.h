#pragma once

#include <string>

#include "inceres/status.h"

namespace inceres::tools {

/// Writes `text` to `path`, all or an error (kIo) that names the path and the system's reason, and
/// no file. `how` is fopen's: "w", or "a" to append, which keeps the file.
Status WriteTextFile(const std::string& path, const std::string& text, const char* how = "w");

}  // namespace inceres::tools
