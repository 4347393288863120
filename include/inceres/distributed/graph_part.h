#pragma once

#include <cstdint>
#include <vector>

#include "inceres/problem/factor_graph.h"

namespace inceres {

/// A variable by the name that all ranks know it by.
struct GlobalVariable {
  std::int64_t id = -1;      ///< ≥ 0, the same on all ranks
  VariableId variable = -1;  ///< what the graph of this rank calls it
};

/// The part of a problem that one rank of a DistributedSolver has.
///
/// Its landmarks are its own, with all their factors; frames it may share. Each frame that a factor
/// touches and that is not constant is listed in `frames`. Ranks that list the same frame start
/// from the same values, with the same manifold, and hold it constant all or none of them. Factors
/// between frames (priors, IMU, relative poses) are on one rank each, whichever lists the frames. A
/// constant needs no id. A rank may have no landmarks, no factors, nothing.
struct GraphPart {
  FactorGraph* graph = nullptr;        ///< written by a solve; outlives it
  std::vector<GlobalVariable> frames;  ///< in any order, each once
  /// For checkpoints only (DistributedOptions::checkpoint): all landmarks that move, each once and
  /// on one rank; ids may equal those of frames.
  std::vector<GlobalVariable> landmarks;
};

}  // namespace inceres
