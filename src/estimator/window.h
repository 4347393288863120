#pragma once

#include <cstdint>
#include <vector>

#include "estimator/window_graph.h"
#include "estimator/window_prior.h"
#include "estimator/window_tracks.h"

namespace inceres::internal {

/// What a SlidingWindowEstimator does, phase by phase: AddFrame is Admit, CreateLandmarks, Solve
/// and Slide, one after the other. A phase that fails leaves frames, tracks and graph in step with
/// each other.
class Window {
 public:
  explicit Window(const SlidingWindowOptions& options) : options_(options), graph_(options_) {}

  Status Start(const WindowStart& start, const std::vector<WindowObservation>& observations);

  /// Takes up a frame where the IMU predicts it, with its views of landmarks. An error: it is not
  /// in the window. (window_frames.cc)
  Status Admit(const WindowFrame& frame, WindowSummary* summary);
  /// Makes landmarks of the newest frame's tracks that have become wide enough. What cannot be made
  /// is tried again when it is seen again.
  Status CreateLandmarks(WindowSummary* summary);
  /// Minimizes within the budget; then takes out landmarks that are wrong.
  Status Solve(WindowSummary* summary);
  /// Takes frames out until the window has its size. (window_slide.cc)
  Status Slide(WindowSummary* summary);

  const SlidingWindowOptions& options() const { return options_; }
  /// That some view in the window is from.
  const FrameRecord& FrameNumbered(std::int64_t number) const;
  const std::vector<FrameRecord>& frames() const { return frames_; }
  const WindowTracks& tracks() const { return tracks_; }
  const WindowGraph& graph() const { return graph_; }
  WindowGraph& mutable_graph() { return graph_; }
  /// The prior of what has left; family −1 before there is one.
  FactorId prior() const { return prior_.factor(); }

 private:
  bool BeginsKeyframe(const WindowFrame& frame, const ImuPreintegrator& imu) const;
  Status Predict(const WindowFrame& frame, ImuPreintegrator* imu, WindowState* state) const;
  Status Connect(const WindowFrame& frame, const ImuPreintegrator& imu,
                 const WindowState& predicted);
  bool Triangulate(const Track& track, Feature* feature) const;
  // A landmark with all views of its track, the first of which is its anchor's.
  void AddLandmark(const Feature& feature, Track* track, GraphEdit* edit);

  // Applies the edit, and only if it was carried out, `tracks` take the place of the window's.
  Status Commit(const GraphEdit& edit, WindowTracks* tracks);

  bool IsWrong(const Track& track) const;
  Status RejectLandmarks(WindowSummary* summary);

  Status MarginalizeOldest(WindowSummary* summary);
  Status Reanchor(WindowSummary* summary);
  Status DropSecondNewest(WindowSummary* summary);
  void DropViewsFrom(std::int64_t frame, WindowTracks* tracks, GraphEdit* edit,
                     WindowSummary* summary) const;
  Status MarginalizeLeft(MarginalizationRequest* request, WindowSummary* summary);

  const SlidingWindowOptions options_;
  WindowGraph graph_;
  std::vector<FrameRecord> frames_;  // oldest first
  WindowTracks tracks_;
  std::int64_t next_number_ = 0;
  bool keeps_second_newest_ = true;  // as the newest frame says
  WindowPrior prior_;
};

}  // namespace inceres::internal
