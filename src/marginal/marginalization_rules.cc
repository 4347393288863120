#include <algorithm>
#include <memory>
#include <set>

#include "inceres/solver/marginalization.h"

namespace inceres {

// Three rules that choose what goes when frames leave a window (docs/algorithms.md,
// "Marginalization"): VINS-Mono's for the oldest frame and for the second-newest, and OKVIS's. They
// read the graph and write a request. What they have in common: for each landmark that a leaving
// frame sees, how many factors it has and which of these touch a leaving frame. A landmark is then
// marginalized (its factors go into the prior), dropped (they are lost), or kept without the
// factors that would tie the prior to it; the prior may join one landmark at most.
//
// Landmarks are taken in the order of their ids: the request, and with it the order of elimination,
// is the same in every run.

namespace {

bool IsFreeLandmark(const FactorGraph& graph, VariableId id) {
  return graph.role(id) == Role::kLandmark && !graph.IsConstant(id);
}

// Calls f(id) for the variables of a factor.
template <typename F>
void ForEachVariable(const FactorGraph& graph, FactorId factor, F&& f) {
  const VariableId* ids = graph.Variables(factor.family, factor.index);
  std::for_each(ids, ids + graph.family(factor.family).num_slots(), f);
}

template <typename Predicate>
bool AnyVariable(const FactorGraph& graph, FactorId factor, Predicate&& predicate) {
  const VariableId* ids = graph.Variables(factor.family, factor.index);
  return std::any_of(ids, ids + graph.family(factor.family).num_slots(), predicate);
}

// The graph, or a copy, where the factors of a variable can be asked for.
class Tracked {
 public:
  explicit Tracked(const FactorGraph& graph) {
    if (!graph.TracksFactors()) {
      copy_ = std::make_unique<FactorGraph>(graph);
      copy_->TrackFactors();
    }
    graph_ = copy_ != nullptr ? copy_.get() : &graph;
  }
  const FactorGraph& operator*() const { return *graph_; }

 private:
  std::unique_ptr<FactorGraph> copy_;
  const FactorGraph* graph_;
};

// Constants are not among them: they stay, and tell the prior what is known exactly.
std::set<VariableId> LandmarksSeenBy(const FactorGraph& graph,
                                     const std::vector<VariableId>& frames) {
  std::set<VariableId> landmarks;
  for (const VariableId frame : frames) {
    if (!graph.HasVariable(frame)) {  // Marginalize names it
      continue;
    }
    graph.ForEachFactorOf(frame, [&](FactorId factor) {
      ForEachVariable(graph, factor, [&](VariableId id) {
        if (IsFreeLandmark(graph, id)) {
          landmarks.insert(id);
        }
      });
    });
  }
  return landmarks;
}

// How many factors a landmark has, and those of them that touch one of these frames.
int CountFactors(const FactorGraph& graph, VariableId landmark, const std::set<VariableId>& frames,
                 std::vector<FactorId>* touching) {
  int count = 0;
  touching->clear();
  graph.ForEachFactorOf(landmark, [&](FactorId factor) {
    ++count;
    if (AnyVariable(graph, factor, [&](VariableId id) { return frames.count(id) > 0; })) {
      touching->push_back(factor);
    }
  });
  return count;
}

}  // namespace

MarginalizationRequest OldestFrameRule(const FactorGraph& graph,
                                       const std::vector<VariableId>& frames, int min_factors) {
  // Where no frame counts as newest, no landmark is kept for its sake: all go, or are dropped.
  return KeyframeRule(graph, frames, {}, min_factors);
}

MarginalizationRequest SecondNewestFrameRule(const FactorGraph& original,
                                             const std::vector<VariableId>& frames) {
  const Tracked tracked(original);
  const FactorGraph& graph = *tracked;
  MarginalizationRequest request;
  request.marginalized = frames;
  const std::set<VariableId> leaving(frames.begin(), frames.end());
  std::vector<FactorId> touching;
  for (const VariableId landmark : LandmarksSeenBy(graph, frames)) {
    // All of its factors go with the frame: nothing would hold it.
    if (CountFactors(graph, landmark, leaving, &touching) == static_cast<int>(touching.size())) {
      request.dropped.push_back(landmark);
    } else {
      // The measurements of the leaving frame are lost, so that the landmark stays out of the
      // prior.
      request.dropped_factors.insert(request.dropped_factors.end(), touching.begin(),
                                     touching.end());
    }
  }
  return request;
}

MarginalizationRequest KeyframeRule(const FactorGraph& original,
                                    const std::vector<VariableId>& leaving,
                                    const std::vector<VariableId>& newest, int min_factors) {
  const Tracked tracked(original);
  const FactorGraph& graph = *tracked;
  MarginalizationRequest request;
  request.marginalized = leaving;
  const std::set<VariableId> gone(leaving.begin(), leaving.end());
  const std::set<VariableId> visible = LandmarksSeenBy(graph, newest);
  std::vector<FactorId> touching;
  for (const VariableId landmark : LandmarksSeenBy(graph, leaving)) {
    const int num_factors = CountFactors(graph, landmark, gone, &touching);
    // It stays only if something other than the leaving frames still measures it.
    if (visible.count(landmark) > 0 && static_cast<int>(touching.size()) < num_factors) {
      request.dropped_factors.insert(request.dropped_factors.end(), touching.begin(),
                                     touching.end());
    } else if (num_factors < min_factors) {
      request.dropped.push_back(landmark);
    } else {
      request.marginalized.push_back(landmark);
    }
  }
  return request;
}

}  // namespace inceres
