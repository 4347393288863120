// How frames leave the window.
#include <algorithm>
#include <utility>

#include "estimator/window.h"
#include "inceres/solver/marginalization.h"

namespace inceres::internal {
namespace {

// Of a marginalization that cannot be done, drops the landmarks at fault. False if it is not
// landmarks.
bool DropOffenders(const std::vector<VariableId>& offenders, const FactorGraph& graph,
                   MarginalizationRequest* request) {
  std::vector<VariableId>& marginalized = request->marginalized;
  for (const VariableId id : offenders) {
    const auto found = std::find(marginalized.begin(), marginalized.end(), id);
    if (found == marginalized.end() || graph.role(id) != Role::kLandmark) {
      return false;
    }
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

Status Window::Slide(WindowSummary* summary) {
  Status status;
  while (status.ok() && static_cast<int>(frames_.size()) > options_.size) {
    status = keeps_second_newest_ ? MarginalizeOldest(summary) : DropSecondNewest(summary);
  }
  return status;
}

bool Window::IsInPrior(VariableId id) const {
  return std::find(in_prior_.begin(), in_prior_.end(), id) != in_prior_.end();
}

Status Window::Marginalize(const MarginalizationOptions& options, MarginalizationRequest* request,
                           WindowSummary* summary) {
  request->marginalized.insert(request->marginalized.end(), left_over_.begin(), left_over_.end());
  const FactorGraph& graph = graph_.solver.graph();
  MarginalizationSummary& done = summary->marginalization;
  int num_marginalized = 0;
  do {
    num_marginalized = CountLandmarks(graph, request->marginalized);
    done = graph_.solver.Marginalize(*request, options);
  } while (done.status.code == StatusCode::kSingular &&
           DropOffenders(done.offenders, graph, request));
  if (done.status.ok()) {
    summary->num_marginalized_landmarks += num_marginalized;
    left_over_.clear();
    prior_ = done.prior;
    in_prior_ = done.kept;
  }
  return done.status;
}

Status Window::MarginalizeOldest(WindowSummary* summary) {
  const FrameRecord oldest = frames_.front();
  if (options_.rule == WindowRule::kKeepSeenLandmarks) {
    const Status status = Reanchor(summary);
    if (!status.ok()) {
      return status;
    }
  }
  MarginalizationRequest request =
      OldestFrameRule(graph_.solver.graph(), {oldest.pose, oldest.speed_bias}, graph_.MinFactors());
  const Status status = Marginalize(options_.marginalization, &request, summary);
  if (status.ok()) {
    summary->num_dropped_landmarks += static_cast<int>(request.dropped.size());
    frames_.erase(frames_.begin());
    tracks_.ForgetOldest(oldest.number);
    summary->left = WindowSummary::Left::kOldest;
    summary->left_time = oldest.time;
  }
  return status;
}

// Landmarks of the oldest frame that the newest one sees, and one more, move on to the next camera
// that sees them.
Status Window::Reanchor(WindowSummary* summary) {
  const FrameRecord& oldest = frames_.front();
  GraphEdit edit(graph_.solver.graph());
  WindowTracks tracks = tracks_;
  int count = 0;
  for (auto& [number, track] : tracks.all()) {
    if (!track.has_landmark() || track.views.size() < 3 ||
        track.views.front().frame != oldest.number ||
        track.views.back().frame != frames_.back().number) {
      continue;
    }
    const FrameRecord& anchor = FrameNumbered(track.views[1].frame);
    const Feature old_feature = graph_.FeatureOf(track.landmark, track.views[0]);
    const Eigen::Vector3d h = graph_.CameraBetween(oldest, anchor).Point(old_feature);
    if (!(h.z() > 0.0)) {
      continue;
    }
    edit.RemoveVariable(track.landmark);
    track.views.erase(track.views.begin());
    const Feature feature{{h.x() / h.z(), h.y() / h.z()}, old_feature.lambda / h.z()};
    track.landmark = graph_.AddLandmark(feature, &track.views[0], &edit);
    for (std::size_t k = 1; k < track.views.size(); ++k) {
      graph_.AddView(track.landmark, anchor, track.views[0], FrameNumbered(track.views[k].frame),
                     &track.views[k], &edit);
    }
    ++count;
  }
  const Status status = edit.empty() ? Status::Ok() : graph_.solver.Apply(edit);
  if (status.ok()) {
    summary->num_reanchored_landmarks += count;
    tracks_ = std::move(tracks);
  }
  return status;
}

// Views from a frame go, with landmarks that are then seen from fewer than two. Those that it
// anchors are: their other view is from the newest frame, if there is one.
void Window::DropViewsFrom(std::int64_t frame, WindowTracks* tracks, GraphEdit* edit,
                           WindowSummary* summary) const {
  for (auto entry = tracks->all().begin(); entry != tracks->all().end();) {
    Track& track = entry->second;
    const auto view = track.ViewFrom(frame);
    if (view != track.views.end()) {
      if (track.has_landmark() && track.views.size() > 2) {
        edit->RemoveFactor(view->factor);
      } else if (track.has_landmark()) {
        edit->RemoveVariable(track.landmark);
        track.landmark = -1;
        ++summary->num_dropped_landmarks;
      }
      track.views.erase(view);
    }
    entry = track.views.empty() ? tracks->all().erase(entry) : std::next(entry);
  }
}

Status Window::DropSecondNewest(WindowSummary* summary) {
  const std::size_t k = frames_.size() - 2;
  const FrameRecord leaving = frames_[k];
  FrameRecord newest = frames_.back();
  ImuPreintegrator imu = graph_.Imu(leaving);
  std::vector<ImuSample> samples = graph_.Imu(newest).samples();
  samples.erase(samples.begin());  // the last one of those before
  Status status = imu.Append(samples);
  if (!status.ok()) {
    return status;
  }
  GraphEdit edit(graph_.solver.graph());
  WindowTracks tracks = tracks_;
  DropViewsFrom(leaving.number, &tracks, &edit, summary);
  edit.RemoveFactor(leaving.imu);
  edit.RemoveFactor(newest.imu);
  newest.imu = graph_.AddImu(imu, frames_[k - 1], newest, &edit);
  MarginalizationRequest request;
  for (const VariableId id : {leaving.pose, leaving.speed_bias}) {
    if (IsInPrior(id)) {
      request.marginalized.push_back(id);
    } else {
      edit.RemoveVariable(id);
    }
  }
  status = graph_.solver.Apply(edit);
  if (!status.ok()) {
    return status;
  }
  frames_.pop_back();
  frames_.back() = newest;
  tracks_ = std::move(tracks);
  summary->left = WindowSummary::Left::kSecondNewest;
  summary->left_time = leaving.time;
  if (!request.marginalized.empty()) {
    // Only the prior touches it, perhaps not in all directions: what it says is used, and no more.
    MarginalizationOptions options = options_.marginalization;
    options.allow_rank_loss = true;
    status = Marginalize(options, &request, summary);
  }
  if (!status.ok()) {
    left_over_ = request.marginalized;
  }
  return status;
}

}  // namespace inceres::internal
