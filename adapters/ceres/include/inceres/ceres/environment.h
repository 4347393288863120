#pragma once

#include "inceres/ceres/solve.h"
#include "inceres/export.h"

namespace inceres {

/// What the environment of this process asks for, as the "in" fields of a SolveReport; the drop-in solves with it, inceres::Solve
/// only if handed it. The variables are read once, at the first call.
///
/// - `INCERES_MODE`: `exact` (default), `incremental`, `stock`, `auto` (in the drop-in: incremental, and exact while that takes
///   less work, as SessionOptions::automatic; one solve here: exact), `fallback` (in
///   the drop-in: each problem is looked at and handed to stock Ceres; here as `stock`).
/// - `INCERES_WINDOWS`: `exact` (default) or `incremental`: in the drop-in's incremental and auto modes, whether problems of a
///   window's size, and windows that slide, are solved exactly (SessionOptions::exact_windows).
/// - `INCERES_CROSS_CHECK`: `1`, `0`, or what asks for the check with these CrossCheckOptions: a list of `keep=ours`,
///   `keep=stock`, `cost=X`, `parameters=X`, `iterations=N`, `radius=X`, `spread=X`.
/// - `INCERES_AB_LOG`: a file for the A/B log.
///
/// A value that is none of these is named in the log, once, and has no effect; the rest holds. In a program that runs with rights
/// its user has not (setuid, setgid, capabilities) none is looked at. Threads: safe.
INCERES_EXPORT SolveReport ReportFromEnvironment();

}  // namespace inceres
