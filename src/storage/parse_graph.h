#pragma once

#include <memory>
#include <vector>

#include "inceres/storage/graph_stream.h"
#include "problem/graph_restorer.h"

namespace inceres::internal {

/// Reads what PrintGraph wrote; what fits together is left to GraphRestorer. A failure is the
/// reader's.
void ParseGraph(GraphReader* reader, GraphParts* parts,
                std::vector<std::shared_ptr<FactorFamily>>* families);

}  // namespace inceres::internal
