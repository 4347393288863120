#pragma once

#include "inceres/io/read_options.h"

namespace inceres::tools {

/// What the flag --max_unpacked_bytes of the tools that read files says.
ReadOptions ReadOptionsFromFlags();

}  // namespace inceres::tools
