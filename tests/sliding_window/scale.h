#pragma once

namespace sliding_window {

/// Runs of 300 frames; short ones where a sanitizer makes everything slow. A short run's trajectory
/// error depends on how far its few solves came: stock Ceres with 50 iterations a solve ends 3 to 5
/// % from stock with 8 after 40 frames, 0.3 % after 300. So where ours takes other steps than
/// stock, a short run may end as far away as stock's does at the least.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr int kNumFramesOfRun = 40;
inline constexpr double kAteToleranceOfOtherSteps = 0.03;
#else
inline constexpr int kNumFramesOfRun = 300;
inline constexpr double kAteToleranceOfOtherSteps = 0.01;
#endif

}  // namespace sliding_window
