// How frames leave the window.
#include <iterator>

#include "estimator/window.h"
#include "inceres/solver/marginalization.h"

// Two ways out, as in VINS-Mono. If the second-newest frame is a keyframe, the oldest frame leaves:
// it is marginalized, and the prior keeps what it knew (docs/algorithms.md, "Marginalization"). If
// not, the second-newest leaves: its views are dropped, and the samples before and after it become
// one measurement, so the IMU's chain has no gap. With WindowRule::kKeepSeenLandmarks, landmarks of
// the oldest frame that are still seen get another anchor first, at the cost of one view each.
//
// Each view is used once, in the graph or in the prior. Marginalization does all or nothing; what
// could not be done is tried again at the next frame.

namespace inceres::internal {

// More than one frame may be too many, after a marginalization that failed.
Status Window::Slide(WindowSummary* summary) {
  Status status;
  bool keeps_second_newest = keeps_second_newest_;
  while (status.ok() && static_cast<int>(frames_.size()) > options_.size) {
    status = keeps_second_newest ? MarginalizeOldest(summary) : DropSecondNewest(summary);
    // The next in its place was a keyframe when it was the second-newest.
    keeps_second_newest = true;
  }
  return status;
}

Status Window::MarginalizeOldest(WindowSummary* summary) {
  // A copy: the record is erased below.
  const FrameRecord oldest = frames_.front();
  if (options_.rule == WindowRule::kKeepSeenLandmarks) {
    const Status status = Reanchor(summary);
    if (!status.ok()) {
      return status;
    }
  }
  // MinFactors: with kBearing, one factor is the bearing alone, which says nothing of the depth.
  // Such landmarks are dropped and not marginalized.
  MarginalizationRequest request =
      OldestFrameRule(graph_.solver.graph(), {oldest.pose, oldest.speed_bias}, graph_.MinFactors());
  const Status status =
      prior_.Marginalize(options_.marginalization, &request, &graph_.solver, summary);
  if (status.ok()) {
    summary->num_dropped_landmarks += static_cast<int>(request.dropped.size());
    // After the graph only: a frame that could not be marginalized stays in the window.
    frames_.erase(frames_.begin());
    // Landmarks of the oldest frame went with it, so their tracks end; others lose a view.
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
    // Fewer than three views would leave one after the oldest has gone: no parallax, no landmark.
    if (!track.has_landmark() || track.views.size() < 3 ||
        track.views.front().frame != oldest.number ||
        track.views.back().frame != frames_.back().number) {
      continue;
    }
    const FrameRecord& anchor = FrameNumbered(track.views[1].frame);
    const Feature old_feature = graph_.FeatureOf(track.landmark, track.views[0]);
    // h is λ times the point in the next camera, h = z m' with λ' = λ / z: bearing and inverse
    // depth there follow without a division by λ. Behind that camera there is no such form: it
    // stays and goes with the oldest frame.
    const Eigen::Vector3d h = graph_.CameraBetween(oldest, anchor).Point(old_feature);
    if (!(h.z() > 0.0)) {
      continue;
    }
    // A new variable, not new values of the old one: all its factors change their anchor. The view
    // from the oldest frame goes with the old variable, so the prior gets no rows of it and stays
    // sparse.
    edit.RemoveVariable(track.landmark);
    track.views.erase(track.views.begin());
    const Feature feature{{h.x() / h.z(), h.y() / h.z()}, old_feature.lambda / h.z()};
    AddLandmark(feature, &track, &edit);
    ++count;
  }
  const Status status = Commit(edit, &tracks);
  if (status.ok()) {
    summary->num_reanchored_landmarks += count;
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
      // Two views or more are left: λ is still determined. With one left, the view stays in the
      // track, and may become a landmark again with the next one.
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

// Marginalizes variables of a frame that has left, in the graph but in no frame of the window. Only
// the prior touches them, perhaps not in all directions: what it says is used, and no more.
Status Window::MarginalizeLeft(MarginalizationRequest* request, WindowSummary* summary) {
  MarginalizationOptions options = options_.marginalization;
  options.allow_rank_loss = true;
  Status status = prior_.Marginalize(options, request, &graph_.solver, summary);
  // They are still in the graph; the next marginalization takes them along.
  if (!status.ok()) {
    prior_.Postpone(request->marginalized);
  }
  return status;
}

namespace {

// Appends the later samples, all integrated at the biases of the earlier measurement. Sample 0 of
// the later one is the interpolated one at the time between them, which the earlier one has as its
// last.
Status AppendLater(const ImuPreintegrator& later, ImuPreintegrator* imu) {
  std::vector<ImuSample> samples = later.samples();
  samples.erase(samples.begin());  // the last one of those before
  return imu->Append(samples);
}

}  // namespace

// The frame before the newest leaves without a trace but for the IMU. It was no keyframe: its image
// shows little that the newest one's does not.
Status Window::DropSecondNewest(WindowSummary* summary) {
  const std::size_t k = frames_.size() - 2;
  const FrameRecord leaving = frames_[k];
  FrameRecord newest = frames_.back();
  ImuPreintegrator imu = graph_.Imu(leaving);  // a copy
  Status status = AppendLater(graph_.Imu(newest), &imu);
  if (!status.ok()) {
    return status;
  }
  GraphEdit edit(graph_.solver.graph());
  WindowTracks tracks = tracks_;
  DropViewsFrom(leaving.number, &tracks, &edit, summary);
  edit.RemoveFactor(leaving.imu);
  edit.RemoveFactor(newest.imu);
  // From the frame before the one that leaves to the newest; with the window too large there is
  // one.
  newest.imu = graph_.AddImu(imu, frames_[k - 1], newest, &edit);
  MarginalizationRequest request;
  // A variable that the prior holds cannot be removed without it. It is marginalized instead, which
  // only involves the prior, since all its other factors go in this edit.
  for (const VariableId id : {leaving.pose, leaving.speed_bias}) {
    if (prior_.Touches(id)) {
      request.marginalized.push_back(id);
    } else {
      edit.RemoveVariable(id);
    }
  }
  status = Commit(edit, &tracks);
  if (!status.ok()) {
    return status;
  }
  // The newest frame moves down by one place, with its new IMU factor.
  frames_.pop_back();
  frames_.back() = newest;
  summary->left = WindowSummary::Left::kSecondNewest;
  summary->left_time = leaving.time;
  return request.marginalized.empty() ? status : MarginalizeLeft(&request, summary);
}

}  // namespace inceres::internal
