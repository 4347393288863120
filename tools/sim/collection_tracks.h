#pragma once

#include "tools/sim/collection_scene.h"

namespace inceres::internal {

/// The true cameras and points of a collection, and who sees whom, projected exactly.
Status MakeCollection(const CollectionOptions& options, const SceneProgress& progress,
                      BalProblem* truth);

}  // namespace inceres::internal
