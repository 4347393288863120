#pragma once

#include <string>

#include "inceres/status.h"
#include "tools/replay/replay_solver.h"
#include "tools/replay/replay_step.h"

namespace inceres::tools {

/// The script that --problem and the flags about it ask for. kInvalidArgument: they are wrong, and
/// why; other errors name the file. Solves the whole problem first where the protocol does.
Status MakeScriptFromFlags(ReplayScript* script);

/// What --num_threads, --max_num_iterations, the tolerances and the program's own flags say:
/// --autodiff, --trust_region and that of the linear solver, whose name and value these are.
/// `landmarks` and `dogleg`: what "auto" means. kInvalidArgument names the flag.
Status ReadReplaySettings(const std::string& solver_flag, const std::string& solver, bool landmarks,
                          bool dogleg, ReplaySettings* settings);

}  // namespace inceres::tools
