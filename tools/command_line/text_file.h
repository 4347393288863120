#pragma once

#include <string>

#include "inceres/status.h"

namespace inceres::tools {

/// Writes `text` to `path`, all or an error (kIo) that names the path and the system's reason.
Status WriteTextFile(const std::string& path, const std::string& text);

}  // namespace inceres::tools
