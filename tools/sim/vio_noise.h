#pragma once

#include "tools/sim/vio_scene.h"

namespace inceres::internal {

// Each turns the exact sequence into a measured one, by its own streams of random numbers.

/// Biases into the frames' truth, and biases and white noise into the IMU samples, which are exact.
void AddImuNoise(const VioSceneOptions& options, VioSequence* sequence);

/// Pixel noise and outliers into the observations, which are exact.
void AddPixelNoise(const VioSceneOptions& options, VioSequence* sequence);

/// Start values from the truth.
void MakeStartValues(const VioSceneOptions& options, VioSequence* sequence);

}  // namespace inceres::internal
