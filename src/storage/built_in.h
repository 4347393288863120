#pragma once

#include "inceres/storage/graph_formats.h"

namespace inceres::internal {

/// The formats of the built-in types. Their names are those of the classes, in snake case, after
/// "inceres.".
void AddBuiltInManifolds(GraphFormats* formats);
void AddBuiltInLosses(GraphFormats* formats);
void AddBuiltInFamilies(GraphFormats* formats);
/// Those of them whose measurements differ in size: diagonal and linear priors, preintegrated IMU
/// samples.
void AddVectorFamilies(GraphFormats* formats);

}  // namespace inceres::internal
