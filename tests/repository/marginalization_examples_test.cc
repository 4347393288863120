// The examples of docs/visual_inertial.md on marginalization and covariance, compiled and run as
// they stand there.
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/covariance.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/marginalization.h"

namespace {

using inceres::VariableId;

// clang-format off
inceres::MarginalizationSummary TakeOut(inceres::IncrementalSolver* from, VariableId pose_0,
                                        VariableId speed_bias_0, VariableId pose_1,
                                        VariableId speed_bias_1, VariableId extrinsics) {
  inceres::IncrementalSolver& solver = *from;
// [quoted in docs/visual_inertial.md]
inceres::MarginalizationRequest request =
    inceres::OldestFrameRule(solver.graph(), {pose_0, speed_bias_0});
request.order = {pose_1, speed_bias_1, extrinsics};  // the prior's columns; the others follow by id
const inceres::MarginalizationSummary summary =
    solver.Marginalize(request, inceres::MarginalizationOptions());
if (!summary.status.ok()) {
  // nothing has changed; summary.offenders are the ids at fault
}
// [end of quote]
  return summary;
}

void AskForCovariance(const inceres::IncrementalSolver& solver, VariableId newest_pose,
                      VariableId speed_bias, double* variance) {
// [quoted in docs/visual_inertial.md]
inceres::GraphCovariance covariance;
const inceres::Status status =
    covariance.Compute(solver, {{newest_pose, newest_pose}, {newest_pose, speed_bias}});
double pose_covariance[36];
covariance.Get(newest_pose, newest_pose, pose_covariance);  // row-major, in the tangent space
// [end of quote]
  EXPECT_TRUE(status.ok()) << status.message;
  *variance = pose_covariance[0];
}
// clang-format on

TEST(VisualInertialExamples, TakeOutAFrameAndAskForTheCovariance) {
  inceres::IncrementalSolver solver({});
  const auto motions = solver.AddFamily(std::make_shared<inceres::RelativePoseFamily>());
  const auto biases = solver.AddFamily(std::make_shared<inceres::DiagonalPriorFamily>(3));
  const auto anchors = solver.AddFamily(std::make_shared<inceres::DiagonalPriorFamily>(7, 7, 6));
  inceres::GraphEdit edit(solver.graph());
  const auto manifold = std::make_shared<inceres::PoseManifold>();
  const double pose[7] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  const double bias[3] = {};
  std::vector<VariableId> poses;
  std::vector<VariableId> speed_biases;
  for (int k = 0; k < 3; ++k) {
    poses.push_back(edit.AddVariable(pose, 7, inceres::Role::kFrame, manifold));
    speed_biases.push_back(edit.AddVariable(bias, 3, inceres::Role::kFrame));
    edit.AddFactor(biases, {{0.0, 0.0, 0.0}, {1.0, 1.0, 1.0}}, {speed_biases.back()});
  }
  edit.AddFactor(anchors, {std::vector<double>(pose, pose + 7), std::vector<double>(7, 10.0)},
                 {poses[0]});
  inceres::RelativePoseFamily::Measurement motion;
  for (int k = 0; k < 6; ++k) {
    motion.sqrt_information[7 * k] = 10.0;
  }
  edit.AddFactor(motions, motion, {poses[0], poses[1]});
  edit.AddFactor(motions, motion, {poses[1], poses[2]});
  ASSERT_TRUE(solver.Apply(edit).ok());
  solver.Update();
  const inceres::MarginalizationSummary summary =
      TakeOut(&solver, poses[0], speed_biases[0], poses[1], speed_biases[1], poses[2]);
  ASSERT_TRUE(summary.status.ok()) << summary.status.message;
  EXPECT_EQ(summary.kept, std::vector<VariableId>{poses[1]});
  solver.Update();
  double variance = 0.0;
  AskForCovariance(solver, poses[2], speed_biases[2], &variance);
  EXPECT_NEAR(variance, 0.01 + 0.01 + 0.01, 1e-6);  // three steps of 0.1 m each
}

}  // namespace
