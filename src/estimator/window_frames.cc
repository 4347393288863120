// How a frame comes into the window.
#include <algorithm>
#include <utility>

#include "estimator/window.h"
#include "estimator/window_input.h"
#include "factors/imu_layout.h"

namespace inceres::internal {

Status Window::Admit(const WindowFrame& frame, WindowSummary* summary) {
  if (frames_.empty()) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "SlidingWindowEstimator: Start must come before AddFrame");
  }
  Status status = CheckFrame(frames_.back().time, frame);
  ImuPreintegrator imu(options_.imu);
  WindowState predicted;
  status = status.ok() ? Predict(frame, &imu, &predicted) : status;
  if (!status.ok()) {
    return status;
  }
  summary->num_tracked = tracks_.CountKnown(frame.observations);
  const bool keeps_second_newest = BeginsKeyframe(frame, imu);
  status = Connect(frame, imu, predicted);
  if (status.ok()) {
    keeps_second_newest_ = keeps_second_newest;
    status = CreateLandmarks(summary);
  }
  return status;
}

// Whether the frame that is the newest now has become a keyframe when `frame` arrives.
bool Window::BeginsKeyframe(const WindowFrame& frame, const ImuPreintegrator& imu) const {
  if (frames_.size() < 2 || tracks_.CountKnown(frame.observations) < options_.min_tracked) {
    return true;
  }
  const FrameRecord& newest = frames_.back();
  return graph_.Imu(newest).delta().dt + imu.delta().dt > options_.max_imu_seconds ||
         tracks_.Parallax(frames_[frames_.size() - 2].number, newest.number) >=
             options_.min_parallax;
}

Status Window::Predict(const WindowFrame& frame, ImuPreintegrator* imu, WindowState* state) const {
  const FrameRecord& newest = frames_.back();
  std::vector<ImuSample> samples;
  Status status = InterpolateImuSamples(frame.imu, newest.time, frame.time, &samples);
  const double* speed_bias = graph_.solver.Values(newest.speed_bias);
  const ImuLayout layout = LayoutOf(options_.imu.conventions);
  if (status.ok()) {
    status =
        imu->Integrate(samples, speed_bias + layout.gyr_column, speed_bias + layout.acc_column);
  }
  *state = graph_.StateOf(newest);
  state->time = frame.time;
  std::array<double, 9> next_speed_bias{};
  if (status.ok()) {
    status = PropagateImu(*imu, graph_.solver.Values(newest.pose), speed_bias, nullptr,
                          state->pose.data(), next_speed_bias.data(), nullptr);
  }
  std::copy_n(next_speed_bias.begin(), 3, state->velocity.begin());
  return status;
}

Status Window::Connect(const WindowFrame& frame, const ImuPreintegrator& imu,
                       const WindowState& predicted) {
  GraphEdit edit(graph_.solver.graph());
  WindowTracks tracks = tracks_;
  FrameRecord record = graph_.AddFrame(next_number_, predicted, &edit);
  record.imu = graph_.AddImu(imu, frames_.back(), record, &edit);
  for (const WindowObservation& seen : frame.observations) {
    Track& track = tracks.all()[seen.track];
    View view{record.number, seen.point, {}};
    if (track.has_landmark()) {
      const View& anchor_view = track.views.front();
      graph_.AddView(track.landmark, FrameNumbered(anchor_view.frame), anchor_view, record, &view,
                     &edit);
    }
    track.views.push_back(view);
  }
  const Status status = graph_.solver.Apply(edit);
  if (status.ok()) {
    ++next_number_;
    frames_.push_back(record);
    tracks_ = std::move(tracks);
  }
  return status;
}

bool Window::Triangulate(const Track& track, Feature* feature) const {
  const View& anchor_view = track.views.front();
  const FrameRecord& anchor = FrameNumbered(anchor_view.frame);
  Triangulation triangulation(anchor_view.point);
  for (auto view = track.views.begin() + 1; view != track.views.end(); ++view) {
    triangulation.AddView(graph_.CameraBetween(anchor, FrameNumbered(view->frame)), view->point);
  }
  *feature = triangulation.Solve();
  return triangulation.parallax() >= options_.min_triangulation_parallax && feature->lambda > 0.0;
}

Status Window::CreateLandmarks(WindowSummary* summary) {
  GraphEdit edit(graph_.solver.graph());
  WindowTracks tracks = tracks_;
  const std::int64_t newest = frames_.back().number;
  for (auto& [number, track] : tracks.all()) {
    Feature feature;
    if (track.has_landmark() || track.views.size() < 2 || track.views.back().frame != newest ||
        !Triangulate(track, &feature)) {
      continue;
    }
    View& anchor_view = track.views.front();
    track.landmark = graph_.AddLandmark(feature, &anchor_view, &edit);
    for (auto view = track.views.begin() + 1; view != track.views.end(); ++view) {
      graph_.AddView(track.landmark, FrameNumbered(anchor_view.frame), anchor_view,
                     FrameNumbered(view->frame), &*view, &edit);
    }
    ++summary->num_new_landmarks;
  }
  const Status status = edit.empty() ? Status::Ok() : graph_.solver.Apply(edit);
  if (status.ok()) {
    tracks_ = std::move(tracks);
  }
  return status;
}

}  // namespace inceres::internal
