#include "estimator/window_prior.h"

#include <algorithm>

namespace inceres::internal {

// Marginalization does all or nothing (docs/algorithms.md, "Marginalization"): landmarks that it
// names as not determined are dropped, and it is asked again.

namespace {

// Of a marginalization that cannot be done, drops the landmarks at fault. False if it is not
// landmarks.
bool DropOffenders(const std::vector<VariableId>& offenders, const FactorGraph& graph,
                   MarginalizationRequest* request) {
  std::vector<VariableId>& marginalized = request->marginalized;
  for (const VariableId id : offenders) {
    // Landmarks only: a frame that is at fault cannot be left out, since it is what must go.
    const auto found = std::find(marginalized.begin(), marginalized.end(), id);
    if (found == marginalized.end() || graph.role(id) != Role::kLandmark) {
      return false;
    }
    // A dropped landmark's information is lost, where a marginalized one's is in the prior.
    marginalized.erase(found);
    request->dropped.push_back(id);
  }
  return !offenders.empty();
}

int CountLandmarks(const FactorGraph& graph, const std::vector<VariableId>& ids) {
  return static_cast<int>(std::count_if(
      ids.begin(), ids.end(), [&](VariableId id) { return graph.role(id) == Role::kLandmark; }));
}

}  // namespace

bool WindowPrior::Touches(VariableId id) const {
  return std::find(touched_.begin(), touched_.end(), id) != touched_.end();
}

// Takes up frames that are left over from before, then tries with fewer landmarks until it succeeds
// or the fault is not a landmark's. Each round drops at least one, so it ends.
Status WindowPrior::Marginalize(const MarginalizationOptions& options,
                                MarginalizationRequest* request, IncrementalSolver* solver,
                                WindowSummary* summary) {
  request->marginalized.insert(request->marginalized.end(), postponed_.begin(), postponed_.end());
  const FactorGraph& graph = solver->graph();
  MarginalizationSummary& done = summary->marginalization;
  int num_marginalized = 0;
  do {
    // Counted before the call: after it the ids are gone from the graph.
    num_marginalized = CountLandmarks(graph, request->marginalized);
    done = solver->Marginalize(*request, options);
  } while (done.status.code == StatusCode::kSingular &&
           DropOffenders(done.offenders, graph, request));
  if (done.status.ok()) {
    summary->num_marginalized_landmarks += num_marginalized;
    postponed_.clear();
    // What the prior touches is remembered: such a frame cannot just be removed (DropSecondNewest).
    factor_ = done.prior;
    touched_ = done.kept;
  }
  return done.status;
}

}  // namespace inceres::internal
