#pragma once

namespace sliding_window {

/// Runs of 300 frames; short ones where a sanitizer makes everything slow.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr int kNumFramesOfRun = 40;
#else
inline constexpr int kNumFramesOfRun = 300;
#endif

}  // namespace sliding_window
