#pragma once

#include <string>

#include "distributed/communicator.h"
#include "distributed/distributed_model.h"
#include "distributed/shared_frames.h"
#include "inceres/distributed/distributed_solver.h"
#include "linearize/evaluator.h"

namespace inceres::internal {

// What a solve does around the loop.

/// Valid on all ranks, and the same on all, but for what may differ. An error names the option and
/// two ranks. Collective.
Status AgreeOnOptions(const Communicator& ranks, const DistributedOptions& options);

/// "factor 7 of …": the first factor that throws when it is evaluated by itself, at the candidate,
/// then at the current point. For the message after something was thrown: factors are evaluated
/// in batches, and an exception does not say of which factor.
std::string DescribeThrower(Evaluator* evaluator);

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
