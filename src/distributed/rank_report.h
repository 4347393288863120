#pragma once

#include "distributed/communicator.h"
#include "distributed/distributed_model.h"
#include "distributed/shared_frames.h"
#include "inceres/distributed/summary.h"

namespace inceres::internal {

/// Sizes of all parts together.
void SumSizes(const Communicator& ranks, const FactorGraph& graph, const Layout& layout,
              const SharedFrames& frames, ProblemSizes* sizes);

/// Counts what a rank sends from its making on.
class TrafficCounter {
 public:
  explicit TrafficCounter(const Communicator& ranks);
  RankReport Report(const FactorGraph& graph, const Layout& layout, const SharedFrames& frames,
                    const DistributedModel& model) const;

 private:
  const Communicator& ranks_;
  double petsc_bytes_;
  Communicator::Traffic messages_;
  Communicator::Traffic reductions_;
};

/// The reports of all ranks, and how unequal they are. Collective.
void GatherReports(const Communicator& ranks, const RankReport& own, DistributedSummary* summary);

}  // namespace inceres::internal
