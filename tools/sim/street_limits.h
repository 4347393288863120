#pragma once

namespace inceres::internal {

// In a tighter circle the bend takes the street out of the image before its points have been seen
// often enough.
constexpr double kMinCircumference = 94.0;

}  // namespace inceres::internal
