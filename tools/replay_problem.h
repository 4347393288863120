#pragma once

#include "inceres/status.h"
#include "tools/replay/replay_step.h"

namespace inceres::tools {

/// The script that --problem and the flags about it ask for. kInvalidArgument: they are wrong, and
/// why; other errors name the file. Solves the whole problem first where the protocol does.
Status MakeScriptFromFlags(int num_threads, ReplayScript* script);

}  // namespace inceres::tools
