#include "estimator/window_graph.h"

#include <algorithm>

#include "factors/imu_math.h"

// What a window is as a graph. A frame is two variables, pose [p(3), q(x, y, z, w)] on PoseManifold
// and nine values of velocity and biases in the order of the IMU's conventions. A landmark is λ or
// (m_x, m_y, λ) in the camera of the first frame that sees it, with role kLandmark, so that
// elimination takes it first. The camera on the body is a constant, borrowed from the options,
// which outlive the graph. Nothing is cached here but ids: values are read from the solver each
// time.

namespace inceres::internal {

// Families are added once and stay, empty or not: all factors of one kind are evaluated in one
// call. The solver comes before them, for they are added to its graph.
WindowGraph::WindowGraph(const SlidingWindowOptions& options)
    : solver(options.solver),
      options_(options),
      has_bearing_(options.landmark_form == LandmarkForm::kBearing),
      gyr_column_(LayoutOf(options.imu.conventions).gyr_column),
      imu_(solver.AddFamily(std::make_shared<ImuFactorFamily>())),
      pose_priors_(solver.AddFamily(std::make_shared<PosePriorFamily>())),
      speed_bias_priors_(solver.AddFamily(std::make_shared<DiagonalPriorFamily>(9))),
      // The first two of three values: m of (m_x, m_y, λ).
      bearings_(solver.AddFamily(std::make_shared<DiagonalPriorFamily>(2, 3, 3))),
      views_(solver.AddFamily(std::make_shared<BodyReprojectionFamily>(
          BodyReprojectionFamily::TimeOffset::kNone,
          has_bearing_ ? BodyReprojectionFamily::Feature::kBearing
                       : BodyReprojectionFamily::Feature::kInverseDepth))) {
}

// Velocity, then biases; the gyroscope's begin at column 3 or 6, and the accelerometer's take the
// other place, 9 minus that.
std::array<double, 9> WindowGraph::SpeedBiasOf(const WindowState& state) const {
  std::array<double, 9> values{};
  std::copy(state.velocity.begin(), state.velocity.end(), values.begin());
  std::copy(state.gyr_bias.begin(), state.gyr_bias.end(), values.begin() + gyr_column_);
  std::copy(state.acc_bias.begin(), state.acc_bias.end(), values.begin() + 9 - gyr_column_);
  return values;
}

WindowState WindowGraph::StateOf(const FrameRecord& record) const {
  WindowState state;
  state.time = record.time;
  const double* speed_bias = solver.Values(record.speed_bias);
  std::copy_n(solver.Values(record.pose), 7, state.pose.begin());
  std::copy_n(speed_bias, 3, state.velocity.begin());
  std::copy_n(speed_bias + gyr_column_, 3, state.gyr_bias.begin());
  std::copy_n(speed_bias + 9 - gyr_column_, 3, state.acc_bias.begin());
  return state;
}

FrameRecord WindowGraph::AddFrame(std::int64_t number, const WindowState& state,
                                  GraphEdit* edit) const {
  FrameRecord record;
  // Of all frames ever: a place in the window changes as others leave.
  record.number = number;
  record.time = state.time;
  record.pose = edit->AddVariable(state.pose.data(), 7, Role::kFrame, pose_manifold_);
  record.speed_bias = edit->AddVariable(SpeedBiasOf(state).data(), 9, Role::kFrame);
  return record;
}

void WindowGraph::AddStart(const WindowStart& start, const FrameRecord& record, GraphEdit* edit) {
  // One value for all factors; the edit reads it where it is, and options never move.
  camera_ = edit->AddBorrowedConstant(options_.body_from_camera.data(), 7);
  PosePriorFamily::Measurement pose;
  std::copy(start.state.pose.begin(), start.state.pose.end(), pose.pose);
  // U is 6×6 and diagonal: its diagonal entries are 7 apart.
  for (std::size_t k = 0; k < 6; ++k) {
    pose.sqrt_information[7 * k] = 1.0 / start.pose_sigma[k];
  }
  edit->AddFactor(pose_priors_, pose, {record.pose});
  // The same layout for means and standard deviations: both go through SpeedBiasOf.
  WindowState sigmas;
  sigmas.velocity = start.velocity_sigma;
  sigmas.gyr_bias = start.gyr_bias_sigma;
  sigmas.acc_bias = start.acc_bias_sigma;
  const std::array<double, 9> mean = SpeedBiasOf(start.state), sigma = SpeedBiasOf(sigmas);
  DiagonalPriorFamily::Measurement speed_bias{{mean.begin(), mean.end()}, {}};
  for (const double s : sigma) {
    speed_bias.sqrt_information.push_back(1.0 / s);
  }
  edit->AddFactor(speed_bias_priors_, speed_bias, {record.speed_bias});
}

// The factor goes from the older frame to the newer one. The preintegration is copied and keeps its
// samples: it integrates itself anew when biases move (docs/algorithms.md, "IMU pre-integration"),
// and later samples can be appended when the frame between two measurements leaves.
FactorId WindowGraph::AddImu(const ImuPreintegrator& imu, const FrameRecord& from,
                             const FrameRecord& to, GraphEdit* edit) {
  return edit->AddFactor(imu_, imu, {from.pose, from.speed_bias, to.pose, to.speed_bias});
}

VariableId WindowGraph::AddLandmark(const Feature& feature, View* anchor_view, GraphEdit* edit) {
  const double values[3] = {feature.m[0], feature.m[1], feature.lambda};
  // The first view is exact: it has no factor, and a family of −1 says so.
  if (!has_bearing_) {
    anchor_view->factor = {};
    return edit->AddVariable(values + 2, 1, Role::kLandmark);
  }
  // The first view is a measurement like the others, on (m_x, m_y), with the same noise and loss.
  const VariableId landmark = edit->AddVariable(values, 3, Role::kLandmark);
  anchor_view->factor =
      edit->AddFactor(bearings_,
                      {{anchor_view->point.begin(), anchor_view->point.end()},
                       {1.0 / options_.feature_sigma[0], 1.0 / options_.feature_sigma[1]}},
                      {landmark}, options_.loss);
  return landmark;
}

void WindowGraph::AddView(VariableId landmark, const FrameRecord& anchor, const View& anchor_view,
                          const FrameRecord& record, View* view, GraphEdit* edit) {
  BodyReprojectionFamily::Measurement measurement;
  // point_i is of use with kInverseDepth only; with kBearing m is part of the variable.
  std::copy(anchor_view.point.begin(), anchor_view.point.end(), measurement.point_i);
  std::copy(view->point.begin(), view->point.end(), measurement.point_j);
  // U is upper triangular, [u00 u01; 0 u11]: entry 1 stays zero, x and y being independent.
  measurement.sqrt_information[0] = 1.0 / options_.feature_sigma[0];
  measurement.sqrt_information[2] = 1.0 / options_.feature_sigma[1];
  view->factor = edit->AddFactor(views_, measurement, {anchor.pose, record.pose, camera_, landmark},
                                 options_.loss);
}

// With kInverseDepth the bearing is where the anchor saw it, for ever.
Feature WindowGraph::FeatureOf(VariableId landmark, const View& anchor_view) const {
  const double* values = solver.Values(landmark);
  return has_bearing_ ? Feature{{values[0], values[1]}, values[2]}
                      : Feature{anchor_view.point, values[0]};
}

RelativeCamera WindowGraph::CameraBetween(const FrameRecord& i, const FrameRecord& j) const {
  return {solver.Values(i.pose), solver.Values(j.pose), options_.body_from_camera.data()};
}

}  // namespace inceres::internal
