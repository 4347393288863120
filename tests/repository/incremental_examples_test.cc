// The examples of docs/incremental.md, compiled and run as they stand there.

#include <cmath>
#include <iostream>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/incremental_solver.h"

namespace {

using inceres::BalReprojectionFamily;
using inceres::FactorId;
using inceres::FamilyHandle;
using inceres::VariableId;

struct Sighting {
  VariableId camera;
  BalReprojectionFamily::Measurement pixel;
};

// clang-format off
VariableId AddCamera(const double* camera_values, bool holds_the_gauge,
                     inceres::IncrementalSolver* to) {
  inceres::IncrementalSolver& solver = *to;
// [quoted in docs/incremental.md]
inceres::GraphEdit edit(solver.graph());
const inceres::VariableId camera = edit.AddVariable(camera_values, 9, inceres::Role::kFrame);
edit.SetConstant(camera, holds_the_gauge);
const inceres::Status status = solver.Apply(edit);
if (!status.ok()) {
  std::cerr << status.message << '\n';  // names the id at fault; nothing has changed
}
// [end of quote]
  EXPECT_TRUE(status.ok()) << status.message;
  return camera;
}

VariableId AddPoint(const double* point_values, const std::vector<Sighting>& sightings,
                    const FamilyHandle<BalReprojectionFamily>& reprojections,
                    inceres::GraphEdit* to, std::vector<FactorId>* factors) {
  inceres::GraphEdit& edit = *to;
// [quoted in docs/incremental.md]
const auto huber = std::make_shared<inceres::HuberLoss>(1.0);
const inceres::VariableId point = edit.AddVariable(point_values, 3, inceres::Role::kLandmark);
for (const Sighting& sighting : sightings) {
  factors->push_back(
      edit.AddFactor(reprojections, sighting.pixel, {sighting.camera, point}, huber));
}
// [end of quote]
  return point;
}

void Revise(VariableId old_camera, VariableId camera, FactorId outlier, FactorId doubtful,
            FactorId moved, const BalReprojectionFamily::Measurement& pixel,
            const FamilyHandle<BalReprojectionFamily>& reprojections, inceres::GraphEdit* to) {
  inceres::GraphEdit& edit = *to;
// [quoted in docs/incremental.md]
edit.Restart();                   // forget what was applied, begin anew on the graph as it is now
edit.RemoveFactor(outlier);
edit.RemoveVariable(old_camera);  // and with it every factor that touches it
edit.SetLoss(doubtful, std::make_shared<inceres::CauchyLoss>(1.0));
edit.SetMeasurement(moved, reprojections, pixel);
edit.SetConstant(camera, true);   // a mask: nothing is evaluated again for it
// [end of quote]
}

void BoundFocalLength(VariableId camera, inceres::IncrementalSolver* of) {
  inceres::IncrementalSolver& solver = *of;
// [quoted in docs/incremental.md]
inceres::GraphEdit bounds(solver.graph());
std::vector<double> least(9, -HUGE_VAL);
least[6] = 100.0;  // pixels, of the focal length
bounds.SetBounds(camera, least.data(), /*upper=*/nullptr);
const inceres::Status bounded = solver.Apply(bounds);
// [end of quote]
  EXPECT_TRUE(bounded.ok()) << bounded.message;
}

inceres::UpdateSummary Update(inceres::IncrementalSolver* updated, VariableId camera,
                              double* focal_length) {
  inceres::IncrementalSolver& solver = *updated;
// [quoted in docs/incremental.md]
const inceres::UpdateSummary summary = solver.Update();
if (summary.termination == inceres::Termination::kFailure) {
  // The message names the factor; the values are those of the last accepted step.
  std::cerr << summary.message << '\n';
}
const double* camera_now = solver.Values(camera);
// [end of quote]
  *focal_length = camera_now[6];
  return summary;
}

// Six cameras side by side look at a wall of points; seven points arrive with each camera.
TEST(IncrementalExamples, GrowReviseUpdate) {
// [quoted in docs/incremental.md]
inceres::IncrementalOptions options;
options.max_solver_time_in_seconds = 0.5;  // an Update ends after this, with the best state so far
inceres::IncrementalSolver solver(options);
// Before an edit is begun:
const auto reprojections = solver.AddFamily(std::make_shared<inceres::BalReprojectionFamily>());
// [end of quote]
  const auto project = [](int camera, const double* point) {
    return BalReprojectionFamily::Measurement{500.0 * (point[0] - 0.3 * camera) / -point[2],
                                              500.0 * point[1] / -point[2]};
  };
  std::vector<VariableId> cameras;
  std::vector<FactorId> factors;
  std::vector<double> last_point;
  double focal_length = 0.0;
  inceres::UpdateSummary summary;
  for (int i = 0; i < 6; ++i) {
    const double x = -0.3 * i + (i > 1 ? 0.01 : 0.0);
    const double values[9] = {0.0, 0.0, 0.0, x, 0.0, 0.0, 500.0, 0.0, 0.0};
    cameras.push_back(AddCamera(values, i < 2, &solver));
    inceres::GraphEdit edit(solver.graph());
    for (int k = 0; k < 7 && i > 0; ++k) {
      const double truth[3] = {0.3 * i + 0.5 * std::sin(2.0 * k), 0.6 * std::cos(3.0 * k),
                               -4.0 - 0.3 * k};
      const double start[3] = {truth[0] + 0.02, truth[1] - 0.02, truth[2] + 0.05};
      std::vector<Sighting> sightings;
      for (int j = 0; j <= i; ++j) {
        sightings.push_back({cameras[j], project(j, truth)});
      }
      AddPoint(start, sightings, reprojections, &edit, &factors);
      last_point.assign(truth, truth + 3);
    }
    ASSERT_TRUE(solver.Apply(edit).ok());
    summary = Update(&solver, cameras.back(), &focal_length);
    EXPECT_NE(summary.termination, inceres::Termination::kFailure) << summary.message;
    BoundFocalLength(cameras.back(), &solver);
  }
  EXPECT_LT(summary.final_cost, 1e-3);
  EXPECT_NEAR(focal_length, 500.0, 5.0);

  // Another edit: a measurement that was right before and is off by a pixel now keeps some cost.
  const std::size_t count = factors.size();
  inceres::GraphEdit edit(solver.graph());
  auto pixel = project(5, last_point.data());
  pixel.x += 1.0;
  Revise(cameras[0], cameras[1], factors[count - 3], factors[count - 2], factors[count - 1], pixel,
         reprojections, &edit);
  const inceres::Status status = solver.Apply(edit);
  ASSERT_TRUE(status.ok()) << status.message;
  EXPECT_FALSE(solver.graph().HasVariable(cameras[0]));
  summary = Update(&solver, cameras.back(), &focal_length);
  EXPECT_EQ(summary.termination, inceres::Termination::kConvergence) << summary.message;
  EXPECT_GT(summary.final_cost, 1e-3);
  EXPECT_LT(summary.final_cost, 0.5);
}
// clang-format on

}  // namespace
