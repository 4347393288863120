#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "estimator/relative_camera.h"
#include "inceres/estimator/sliding_window_estimator.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/incremental_solver.h"

namespace inceres::internal {

/// A frame of the window and its place in the graph.
struct FrameRecord {
  std::int64_t number = 0;  // of all frames ever
  double time = 0.0;
  VariableId pose = -1;
  VariableId speed_bias = -1;
  FactorId imu;  // from the frame before it
};

/// A track as seen in a frame; the factor, if there is one.
struct View {
  std::int64_t frame = 0;
  std::array<double, 2> point{};
  FactorId factor;
};

/// The graph of a window: which variables and factors frames, landmarks and views are. Additions go
/// into an edit of solver.graph(), which the caller applies.
class WindowGraph {
 public:
  explicit WindowGraph(const SlidingWindowOptions& options);

  /// The variables of a frame.
  FrameRecord AddFrame(std::int64_t number, const WindowState& state, GraphEdit* edit) const;
  /// What is known of the first one.
  void AddStart(const WindowStart& start, const FrameRecord& record, GraphEdit* edit);
  FactorId AddImu(const ImuPreintegrator& imu, const FrameRecord& from, const FrameRecord& to,
                  GraphEdit* edit);
  /// A landmark with its view from its anchor.
  VariableId AddLandmark(const Feature& feature, View* anchor_view, GraphEdit* edit);
  /// A later view of it.
  void AddView(VariableId landmark, const FrameRecord& anchor, const View& anchor_view,
               const FrameRecord& record, View* view, GraphEdit* edit);

  WindowState StateOf(const FrameRecord& record) const;
  Feature FeatureOf(VariableId landmark, const View& anchor_view) const;
  const ImuPreintegrator& Imu(const FrameRecord& record) const {
    return imu_->measurement(record.imu.index);
  }
  RelativeCamera CameraBetween(const FrameRecord& i, const FrameRecord& j) const;

  /// The fewest factors that determine a landmark.
  int MinFactors() const { return has_bearing_ ? 2 : 1; }

  IncrementalSolver solver;

 private:
  std::array<double, 9> SpeedBiasOf(const WindowState& state) const;

  const SlidingWindowOptions& options_;
  const bool has_bearing_;
  const int gyr_column_;  // of a speed-bias
  std::shared_ptr<const Manifold> pose_manifold_ = std::make_shared<PoseManifold>();
  const FamilyHandle<ImuFactorFamily> imu_;
  const FamilyHandle<PosePriorFamily> pose_priors_;
  const FamilyHandle<DiagonalPriorFamily> speed_bias_priors_;
  const FamilyHandle<DiagonalPriorFamily> bearings_;
  const FamilyHandle<BodyReprojectionFamily> views_;
  VariableId camera_ = -1;
};

}  // namespace inceres::internal
