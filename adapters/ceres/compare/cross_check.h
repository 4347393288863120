#pragma once

#include <functional>
#include <string>

#include "adapters/ceres/fallback/gate.h"

namespace inceres::internal {

/// Whether a solve may be done twice: not if it has lasting effects.
enum class Repeatable { kNo, kYes };

/// Solves what the caller asked for into a blank summary and report: by `ours`, which is stock's
/// fallback too; or by both and compared, or written to the A/B log. The call's report may be null,
/// that of `ours` is not. `obstacle`: why `ours` is known to decline it, or empty.
///
/// Compared: unless ours declines the problem, stock solves it from the same start. A disagreement
/// is logged, what is to be kept is left in the summary and user memory, report->comparison is
/// filled, and a line appended to the A/B log; not for a strict refusal, where neither solves it.
/// Where ours declines only when it plans, it is not compared either: what stock may have done
/// before is dropped, and stock solves as without a comparison.
/// Stock gets a copy of the ordering and the options without callbacks and progress output; the
/// rest, also update_state_every_iteration, as given, for cost functions that read the caller's
/// memory must see in it what they would. The caller's callbacks are thus called as in one solve by
/// ours. Ours goes first, but with a log the two take turns. What looks like a violation is looked
/// at again by SecondOpinion.
///
/// An exception out of user code passes through a comparison and leaves user memory as at the
/// start.
void SolveAsAsked(SolveCall call, const std::function<void(const SolveCall&)>& ours,
                  Repeatable repeatable, const std::string& obstacle = "");

}  // namespace inceres::internal
