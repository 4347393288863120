// How a frame comes into the window.
#include <algorithm>
#include <utility>

#include "estimator/window.h"
#include "estimator/window_input.h"
#include "factors/imu_math.h"

// A frame is predicted by the IMU, connected with the frame before it and with the landmarks that
// it sees, and tracks that have become wide enough get landmarks. Whether the frame before it is a
// keyframe is decided before that, from what the images show (VINS-Mono, Qin, Li & Shen 2018,
// section V.A), and is carried out when the window slides, after the solve.

namespace inceres::internal {

Status Window::Admit(const WindowFrame& frame, WindowSummary* summary) {
  if (frames_.empty()) {
    return Status::Error(StatusCode::kInvalidArgument,
                         "SlidingWindowEstimator: Start must come before AddFrame");
  }
  // Everything that can be wrong with the input is found before anything changes.
  Status status = CheckFrame(frames_.back().time, frame);
  ImuPreintegrator imu(options_.imu);
  WindowState predicted;
  status = status.ok() ? Predict(frame, &imu, &predicted) : status;
  if (!status.ok()) {
    return status;
  }
  // Counted before the frame's own views are in: known means seen before.
  summary->num_tracked = tracks_.CountKnown(frame.observations);
  // The decision is kept only if the frame came in, since it is about what leaves because of it.
  const bool keeps_second_newest = BeginsKeyframe(frame, imu);
  status = Connect(frame, imu, predicted);
  if (status.ok()) {
    keeps_second_newest_ = keeps_second_newest;
  }
  return status;
}

// Whether the frame that is the newest now has become a keyframe when `frame` arrives.
bool Window::BeginsKeyframe(const WindowFrame& frame, const ImuPreintegrator& imu) const {
  // Few known tracks: the view has changed, or the tracker has lost it, and the newest frame is
  // worth keeping whatever the parallax.
  if (frames_.size() < 2 || tracks_.CountKnown(frame.observations) < options_.min_tracked) {
    return true;
  }
  const FrameRecord& newest = frames_.back();
  // First a measurement of the IMU that would span too long if the two were joined, then the motion
  // between the two newest frames as the image shows it. Rotation is not taken out of it: the mean
  // distance is of the points as they were seen.
  return graph_.Imu(newest).delta().dt + imu.delta().dt > options_.max_imu_seconds ||
         tracks_.Parallax(frames_[frames_.size() - 2].number, newest.number) >=
             options_.min_parallax;
}

// Integrates from the newest frame's time at its current biases, so that the first-order correction
// begins at zero, and propagates its state. That is also where the frame starts in the solve.
Status Window::Predict(const WindowFrame& frame, ImuPreintegrator* imu, WindowState* state) const {
  const FrameRecord& newest = frames_.back();
  std::vector<ImuSample> samples;
  // The samples are cut and interpolated at both times: the preintegration begins and ends where
  // states are.
  Status status = InterpolateImuSamples(frame.imu, newest.time, frame.time, &samples);
  const double* speed_bias = graph_.solver.Values(newest.speed_bias);
  const ImuLayout layout = LayoutOf(options_.imu.conventions);
  if (status.ok()) {
    status =
        imu->Integrate(samples, speed_bias + layout.gyr_column, speed_bias + layout.acc_column);
  }
  // Biases stay as they are, which is the mean of their random walk. Only the pose and the velocity
  // move.
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

// One edit with the two variables of the frame, its IMU factor and its views of landmarks. A view
// of a track without a landmark is only noted.
Status Window::Connect(const WindowFrame& frame, const ImuPreintegrator& imu,
                       const WindowState& predicted) {
  GraphEdit edit(graph_.solver.graph());
  WindowTracks tracks = tracks_;
  FrameRecord record = graph_.AddFrame(next_number_, predicted, &edit);
  record.imu = graph_.AddImu(imu, frames_.back(), record, &edit);
  for (const WindowObservation& seen : frame.observations) {
    // A track that is not there yet is made here.
    Track& track = tracks.all()[seen.track];
    View view{record.number, seen.point, {}};
    if (track.has_landmark()) {
      const View& anchor_view = track.views.front();
      graph_.AddView(track.landmark, FrameNumbered(anchor_view.frame), anchor_view, record, &view,
                     &edit);
    }
    track.views.push_back(view);
  }
  const Status status = Commit(edit, &tracks);
  if (status.ok()) {
    ++next_number_;
    frames_.push_back(record);
  }
  return status;
}

// A landmark needs parallax, or its λ is noise, and must be in front of its anchor. The bearing is
// that of the first view; only λ is fitted, which is one linear equation per coordinate.
bool Window::Triangulate(const Track& track, Feature* feature) const {
  const View& anchor_view = track.views.front();
  const FrameRecord& anchor = FrameNumbered(anchor_view.frame);
  Triangulation triangulation(anchor_view.point);
  for (auto view = track.views.begin() + 1; view != track.views.end(); ++view) {
    // At the predicted pose of the newest frame and the estimated ones of the others.
    triangulation.AddView(graph_.CameraBetween(anchor, FrameNumbered(view->frame)), view->point);
  }
  *feature = triangulation.Solve();
  return triangulation.parallax() >= options_.min_triangulation_parallax && feature->lambda > 0.0;
}

// Only tracks that the newest frame sees: others have learned nothing since they were last tried.
Status Window::CreateLandmarks(WindowSummary* summary) {
  GraphEdit edit(graph_.solver.graph());
  WindowTracks tracks = tracks_;
  const std::int64_t newest = frames_.back().number;
  int count = 0;
  for (auto& [number, track] : tracks.all()) {
    Feature feature;
    if (track.has_landmark() || track.views.size() < 2 || track.views.back().frame != newest ||
        !Triangulate(track, &feature)) {
      continue;
    }
    AddLandmark(feature, &track, &edit);
    ++count;
  }
  const Status status = Commit(edit, &tracks);
  if (status.ok()) {
    summary->num_new_landmarks += count;
  }
  return status;
}

// All views the track has are used at once, from its anchor on.
void Window::AddLandmark(const Feature& feature, Track* track, GraphEdit* edit) {
  View& anchor_view = track->views.front();
  const FrameRecord& anchor = FrameNumbered(anchor_view.frame);
  track->landmark = graph_.AddLandmark(feature, &anchor_view, edit);
  for (auto view = track->views.begin() + 1; view != track->views.end(); ++view) {
    graph_.AddView(track->landmark, anchor, anchor_view, FrameNumbered(view->frame), &*view, edit);
  }
}

}  // namespace inceres::internal
