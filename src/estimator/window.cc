#include "estimator/window.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/window_input.h"

// A window's first frame, its solves, and the landmarks that a solve shows to be wrong
// (window_frames.cc: how frames come in; window_slide.cc: how they leave). All phases change the
// window in the same way: an edit of the graph is gathered along with a copy of the tracks, the
// edit is applied, and only if it was carried out does the copy take the place of the tracks. An
// edit is done as a whole or not at all, so graph and tracks never disagree, whatever fails.

namespace inceres::internal {

const FrameRecord& Window::FrameNumbered(std::int64_t number) const {
  // Frames are numbered over the whole life of the estimator and few at a time: a linear search.
  // The caller knows that there is one.
  return *std::find_if(frames_.begin(), frames_.end(),
                       [number](const FrameRecord& frame) { return frame.number == number; });
}

Status Window::Start(const WindowStart& start, const std::vector<WindowObservation>& observations) {
  Status status = options_.Validate();
  if (status.ok() && !frames_.empty()) {
    status = Status::Error(StatusCode::kInvalidArgument,
                           "SlidingWindowEstimator: Start was called before");
  }
  status = status.ok() ? CheckStart(start) : status;
  status = status.ok() ? CheckObservations(start.state.time, observations) : status;
  if (!status.ok()) {
    return status;
  }
  GraphEdit edit(graph_.solver.graph());
  const FrameRecord record = graph_.AddFrame(next_number_, start.state, &edit);
  graph_.AddStart(start, record, &edit);
  status = graph_.solver.Apply(edit);
  if (status.ok()) {
    ++next_number_;
    frames_.push_back(record);
    // A first view makes no landmark: it has no factor, and waits for a second one.
    for (const WindowObservation& seen : observations) {
      tracks_.all()[seen.track].views.push_back({record.number, seen.point, {}});
    }
  }
  return status;
}

// Minimizes within the budget of the options. A solve that stops at the budget is a success: the
// next frame goes on from there, with most of what was computed.
Status Window::Solve(WindowSummary* summary) {
  graph_.solver.Update(&summary->update);
  if (summary->update.termination != Termination::kFailure) {
    return RejectLandmarks(summary);
  }
  // What has come last is at fault, or else the next solve fails as well: the views of the newest
  // frame go.
  GraphEdit edit(graph_.solver.graph());
  WindowTracks tracks = tracks_;
  DropViewsFrom(frames_.back().number, &tracks, &edit, summary);
  // Whether they could be dropped or not: the solve is what failed.
  static_cast<void>(Commit(edit, &tracks));
  return Status::Error(
      StatusCode::kEvaluationFailed,
      "the solve failed, and the frame's views are dropped: " + summary->update.message);
}

// Whether a landmark is behind a camera that sees it, or its views err too much.
bool Window::IsWrong(const Track& track) const {
  const View& anchor_view = track.views.front();
  const FrameRecord& anchor = FrameNumbered(anchor_view.frame);
  const Feature feature = graph_.FeatureOf(track.landmark, anchor_view);
  // How far the anchor's own view is off: with kInverseDepth it is exact and this is zero.
  double sum = std::hypot((feature.m[0] - anchor_view.point[0]) / options_.feature_sigma[0],
                          (feature.m[1] - anchor_view.point[1]) / options_.feature_sigma[1]);
  // The other views by the current values, each in units of its standard deviation; lengths, not
  // squares, so that one bad view among many counts less.
  for (auto view = track.views.begin() + 1; view != track.views.end(); ++view) {
    std::array<double, 2> point{};
    if (!graph_.CameraBetween(anchor, FrameNumbered(view->frame)).Project(feature, &point)) {
      return true;
    }
    sum += std::hypot((point[0] - view->point[0]) / options_.feature_sigma[0],
                      (point[1] - view->point[1]) / options_.feature_sigma[1]);
  }
  // A sum that is NaN counts as wrong: the comparison is negated.
  return feature.lambda <= 0.0 ||
         !(sum <= options_.max_mean_error * static_cast<double>(track.views.size()));
}

// Takes wrong landmarks out after the solve, in which the loss alone limits what they do. Their
// factors leave with the variable. The whole track goes: what is seen of it next begins a new one,
// without the views that misled this one.
Status Window::RejectLandmarks(WindowSummary* summary) {
  GraphEdit edit(graph_.solver.graph());
  WindowTracks tracks = tracks_;
  // In the order of the tracks' numbers, which makes edits the same from run to run.
  for (auto entry = tracks.all().begin(); entry != tracks.all().end();) {
    const bool wrong = entry->second.has_landmark() && IsWrong(entry->second);
    if (wrong) {
      edit.RemoveVariable(entry->second.landmark);
      ++summary->num_rejected_landmarks;
    }
    entry = wrong ? tracks.all().erase(entry) : std::next(entry);
  }
  return Commit(edit, &tracks);
}

Status Window::Commit(const GraphEdit& edit, WindowTracks* tracks) {
  const Status status = edit.empty() ? Status::Ok() : graph_.solver.Apply(edit);
  if (status.ok()) {
    tracks_ = std::move(*tracks);
  }
  return status;
}

}  // namespace inceres::internal
