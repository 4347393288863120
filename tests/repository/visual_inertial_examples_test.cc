// The examples of docs/visual_inertial.md, compiled and run as they stand there.

#include <iostream>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/imu_factor.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"

namespace {

// Ten seconds at rest at 200 Hz, but for a biased gyroscope.
std::vector<inceres::ImuSample> BufferedSamples() {
  std::vector<inceres::ImuSample> samples(2001);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    samples[k].time = 0.005 * static_cast<double>(k);
    samples[k].gyr[2] = 0.05;
    samples[k].acc[2] = 9.81;
  }
  return samples;
}

struct Frame {
  double pose[7] = {0, 0, 0, 0, 0, 0, 1};
  double speed_bias[9] = {};
  inceres::VariableId pose_id = -1;
  inceres::VariableId speed_bias_id = -1;
};

TEST(VisualInertialPage, AWindowOfTwoFrames) {
  const std::vector<inceres::ImuSample> buffered = BufferedSamples();
  const double t_i = 1.002;
  const double t_j = 1.302;
  Frame i;
  // clang-format off
// [quoted in docs/visual_inertial.md]
inceres::ImuOptions options;
options.conventions = inceres::ImuConventions::Vins(9.81);
options.noise = {0.004, 0.08, 2e-4, 4e-3};  // gyr, acc, their biases' walks

inceres::IncrementalSolver solver({});
const auto imu_factors = solver.AddFamily(std::make_shared<inceres::ImuFactorFamily>());
const auto pose_priors = solver.AddFamily(std::make_shared<inceres::PosePriorFamily>());
const auto speed_bias_priors = solver.AddFamily(std::make_shared<inceres::SpeedBiasPriorFamily>());
auto pose_manifold = std::make_shared<inceres::PoseManifold>();  // LeftPoseManifold with Okvis()
// [end of quote]

// [quoted in docs/visual_inertial.md]
std::vector<inceres::ImuSample> samples;
inceres::ImuPreintegrator imu(options);
inceres::Status status = inceres::InterpolateImuSamples(buffered, t_i, t_j, &samples);
if (status.ok()) {
  status = imu.Integrate(samples, i.speed_bias + 6, i.speed_bias + 3);  // VINS: v, b_a, b_g
}
Frame j;
if (status.ok()) {
  status = inceres::PropagateImu(imu, i.pose, i.speed_bias, nullptr, j.pose, j.speed_bias, nullptr);
}
if (!status.ok()) {
  std::cerr << status.message << '\n';  // which sample, and what is wrong with it
}

inceres::GraphEdit edit(solver.graph());
for (Frame* frame : {&i, &j}) {
  frame->pose_id = edit.AddVariable(frame->pose, 7, inceres::Role::kFrame, pose_manifold);
  frame->speed_bias_id = edit.AddVariable(frame->speed_bias, 9, inceres::Role::kFrame);
}
edit.AddFactor(imu_factors, imu, {i.pose_id, i.speed_bias_id, j.pose_id, j.speed_bias_id});
// [end of quote]
  // clang-format on
  ASSERT_TRUE(status.ok()) << status.message;
  inceres::PosePriorFamily::Measurement at_rest;
  inceres::SpeedBiasPriorFamily::Measurement still;
  for (int k = 0; k < 6; ++k) {
    at_rest.sqrt_information[7 * k] = 1000.0;
  }
  for (int k = 0; k < 9; ++k) {
    still.sqrt_information[10 * k] = k < 3 ? 1000.0 : 1.0;
  }
  edit.AddFactor(pose_priors, at_rest, {i.pose_id});
  edit.AddFactor(pose_priors, at_rest, {j.pose_id});
  edit.AddFactor(speed_bias_priors, still, {i.speed_bias_id});
  edit.AddFactor(speed_bias_priors, still, {j.speed_bias_id});
  ASSERT_TRUE(solver.Apply(edit).ok());
  const inceres::UpdateSummary summary = solver.Update();
  EXPECT_NE(summary.termination, inceres::Termination::kFailure) << summary.message;
  EXPECT_GT(summary.num_recentered_factors, 0) << "the gyroscope's bias was not that integrated at";
  EXPECT_NEAR(solver.Values(i.speed_bias_id)[8], 0.05, 0.01);
}

TEST(VisualInertialPage, ALandmarkSeenByADistortedCamera) {
  inceres::FactorGraph graph;
  const double body_pose[7] = {0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  const double camera_on_body[7] = {0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0};
  const double homogeneous_point[4] = {0.2, 0.3, 4.0, 1.0};
  const double u = 380.0, v = 270.0;
  // clang-format off
// [quoted in docs/visual_inertial.md]
inceres::PinholeCamera camera;
camera.f_x = camera.f_y = 458.0;
camera.c_x = 367.0;
camera.c_y = 248.0;
camera.k1 = -0.283;
camera.k2 = 0.0739;
const auto seen = graph.AddFamily(std::make_shared<inceres::PointReprojectionFamily>(
    camera, inceres::LandmarkKind::kHomogeneous, inceres::Perturbation::kLeft));
auto left_pose = std::make_shared<inceres::LeftPoseManifold>();
const inceres::VariableId T_wb = graph.AddVariable(body_pose, 7, inceres::Role::kFrame, left_pose);
const inceres::VariableId T_bc =
    graph.AddVariable(camera_on_body, 7, inceres::Role::kFrame, left_pose);
auto scale_stays = std::make_shared<inceres::SubsetManifold>(4, std::vector<int>{3});
const inceres::VariableId point =
    graph.AddVariable(homogeneous_point, 4, inceres::Role::kLandmark, scale_stays);
graph.SetConstant(T_bc, true);
graph.AddFactor(seen, {{u, v}, {1.0, 0.0, 1.0}}, {T_wb, T_bc, point},
                std::make_shared<inceres::CauchyLoss>(1.0));
// [end of quote]
  // clang-format on
  inceres::SolverOptions options;
  options.function_tolerance = 0.0;
  const inceres::Summary summary = inceres::Solve(options, &graph);
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_GT(summary.initial_cost, 0.1);
  EXPECT_LT(summary.final_cost, 1e-12);
  EXPECT_EQ(graph.Values(point)[3], 1.0);
}

}  // namespace
