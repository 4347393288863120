#pragma once

#include "inceres/storage/graph_formats.h"

namespace inceres::internal {

/// The formats of built-in families whose measurements differ in size: diagonal and linear priors,
/// preintegrated IMU samples.
void AddVectorFamilies(GraphFormats* formats);

}  // namespace inceres::internal
