// Small scenes, measured exactly, that the visual factors must bring back to the truth from a start
// beside it.
#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "factors/visual_states.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/solver/solver.h"

namespace inceres {
namespace {

using test::Vector3;

constexpr int kPoses = 6;
constexpr int kPoints = 30;
const PinholeCamera kPinhole{461.0, 458.0, 365.0, 247.0, -0.28, 0.07, 2e-4, -1.8e-3};
const StereoCamera kStereo{435.0, 437.0, 367.0, 252.0, 0.5};

// A body moves sideways past points some meters ahead; its cameras look ahead, the second one
// beside the first.
class Scene {
 public:
  Scene() : random_(91) {
    for (int i = 0; i < kPoses; ++i) {
      std::vector<double> pose{0.4 * i, 0.1 * std::sin(2.0 * i), 0.05 * i, 0, 0, 0, 1};
      test::RandomRotation(random_, 0.1, pose.data() + 3);
      poses.push_back(pose);
    }
    for (int k = 0; k < kPoints; ++k) {
      points.push_back(
          {1.0 + 2.0 * random_.Unit(), 2.0 * random_.Unit(), random_.Between(4.0, 9.0)});
    }
  }

  Vector3 InCamera(int pose, int camera, int point) const {
    const std::vector<double>& X = points[static_cast<std::size_t>(point)];
    return test::Into(cameras[camera],
                      test::Into(poses[static_cast<std::size_t>(pose)], {X[0], X[1], X[2]}));
  }

  // The values moved by up to `size` in each tangent direction.
  std::vector<double> Beside(const std::vector<double>& x, const Manifold* manifold, double size) {
    std::vector<double> moved = x;
    const std::vector<double> tangent = random_.Vector(
        manifold == nullptr ? x.size() : static_cast<std::size_t>(manifold->TangentSize()));
    std::vector<double> delta;
    for (const double t : tangent) {
      delta.push_back(size * t);
    }
    if (manifold != nullptr) {
      EXPECT_TRUE(manifold->Plus(x.data(), delta.data(), moved.data()));
    } else {
      for (std::size_t k = 0; k < x.size(); ++k) {
        moved[k] += delta[k];
      }
    }
    return moved;
  }

  // Poses into the graph, all but the first `num_known` beside the truth.
  void AddPoses(FactorGraph* graph, const std::shared_ptr<const Manifold>& manifold,
                int num_known) {
    for (int i = 0; i < kPoses; ++i) {
      const std::vector<double>& truth = poses[static_cast<std::size_t>(i)];
      const std::vector<double> start = i < num_known ? truth : Beside(truth, manifold.get(), 0.02);
      pose_ids.push_back(graph->AddVariable(start.data(), 7, Role::kFrame, manifold));
      graph->SetConstant(pose_ids.back(), i < num_known);
    }
  }

  void ExpectTrue(const FactorGraph& graph, VariableId id, const std::vector<double>& truth,
                  double tolerance = 1e-8) const {
    for (std::size_t k = 0; k < truth.size(); ++k) {
      ASSERT_NEAR(graph.Values(id)[k], truth[k], tolerance) << "variable " << id << ", value " << k;
    }
  }

  std::vector<std::vector<double>> poses, points;
  std::vector<double> cameras[2] = {{0.1, 0.0, 0.05, 0, 0, 0, 1},
                                    {0.6, 0.02, 0.0, 0.0, 0.05, 0.0, std::sqrt(1.0 - 0.0025)}};
  std::vector<VariableId> pose_ids;

 private:
  test::Random random_;
};

void SolveIt(FactorGraph* graph) {
  SolverOptions options;
  options.function_tolerance = 0.0;
  options.parameter_tolerance = 1e-14;
  options.max_num_iterations = 100;
  const Summary summary = Solve(options, graph);
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_GT(summary.initial_cost, 1.0) << "the start is no start";
  EXPECT_LT(summary.final_cost, 1e-14 * summary.initial_cost);
}

// All poses see all points through camera 0; q and −q, (X, ω) and its multiples are told apart only
// by what they mean.
template <typename Family, typename Measure>
void ExpectRecovers(std::shared_ptr<Family> family, LandmarkKind landmark,
                    const std::shared_ptr<const Manifold>& pose_manifold,
                    const std::shared_ptr<const Manifold>& landmark_manifold, int num_known,
                    const Measure& measure) {
  Scene scene;
  FactorGraph graph;
  scene.AddPoses(&graph, pose_manifold, num_known);
  const VariableId camera =
      graph.AddVariable(scene.cameras[0].data(), 7, Role::kFrame, pose_manifold);
  graph.SetConstant(camera, true);
  const auto handle = graph.AddFamily(family);
  std::vector<VariableId> landmarks;
  for (int k = 0; k < kPoints; ++k) {
    std::vector<double> X = scene.points[static_cast<std::size_t>(k)];
    if (landmark == LandmarkKind::kHomogeneous) {
      X.push_back(1.0);
    }
    const std::vector<double> start =
        scene.Beside(X, landmark_manifold.get(), landmark_manifold == nullptr ? 0.2 : 0.02);
    landmarks.push_back(graph.AddVariable(start.data(), static_cast<int>(X.size()), Role::kLandmark,
                                          landmark_manifold));
    for (int i = 0; i < kPoses; ++i) {
      graph.AddFactor(handle, measure(scene.InCamera(i, 0, k)),
                      {scene.pose_ids[static_cast<std::size_t>(i)], camera, landmarks.back()});
    }
  }
  SolveIt(&graph);
  for (int i = 0; i < kPoses; ++i) {
    scene.ExpectTrue(graph, scene.pose_ids[static_cast<std::size_t>(i)],
                     scene.poses[static_cast<std::size_t>(i)]);
  }
  for (int k = 0; k < kPoints; ++k) {
    const double* values = graph.Values(landmarks[static_cast<std::size_t>(k)]);
    const double omega = landmark == LandmarkKind::kHomogeneous ? values[3] : 1.0;
    for (std::size_t c = 0; c < 3; ++c) {
      ASSERT_NEAR(values[c] / omega, scene.points[static_cast<std::size_t>(k)][c], 1e-7)
          << "point " << k;
    }
  }
}

TEST(VisualSolver, PixelsOfPointsAndOfHomogeneousPoints) {
  const auto measure = [](const Vector3& P) {
    PixelObservation seen;
    kPinhole.Project(static_cast<double>(P[0] / P[2]), static_cast<double>(P[1] / P[2]),
                     seen.pixel);
    return seen;
  };
  const auto right = std::make_shared<PoseManifold>();
  const auto left = std::make_shared<LeftPoseManifold>();
  ExpectRecovers(std::make_shared<PointReprojectionFamily>(kPinhole), LandmarkKind::kPoint, right,
                 nullptr, 2, measure);
  ExpectRecovers(std::make_shared<PointReprojectionFamily>(kPinhole, LandmarkKind::kHomogeneous),
                 LandmarkKind::kHomogeneous, right, std::make_shared<SphereManifold>(4), 2,
                 measure);
  ExpectRecovers(std::make_shared<PointReprojectionFamily>(kPinhole, LandmarkKind::kHomogeneous,
                                                           Perturbation::kLeft),
                 LandmarkKind::kHomogeneous, left,
                 std::make_shared<SubsetManifold>(4, std::vector<int>{3}), 2, measure);
}

// The baseline is known: one known pose is enough.
TEST(VisualSolver, StereoPixels) {
  const auto measure = [](const Vector3& P) {
    StereoObservation seen;
    seen.left[0] = static_cast<double>(kStereo.f_x * P[0] / P[2] + kStereo.c_x);
    seen.left[1] = static_cast<double>(kStereo.f_y * P[1] / P[2] + kStereo.c_y);
    seen.right_u = seen.left[0] - static_cast<double>(kStereo.f_x * kStereo.baseline / P[2]);
    return seen;
  };
  ExpectRecovers(std::make_shared<StereoReprojectionFamily>(kStereo), LandmarkKind::kPoint,
                 std::make_shared<PoseManifold>(), nullptr, 1, measure);
  ExpectRecovers(std::make_shared<StereoReprojectionFamily>(kStereo, LandmarkKind::kHomogeneous,
                                                            Perturbation::kLeft),
                 LandmarkKind::kHomogeneous, std::make_shared<LeftPoseManifold>(),
                 std::make_shared<SphereManifold>(4), 1, measure);
}

TEST(VisualSolver, Bearings) {
  const auto measure = [](const Vector3& P) {
    return BearingObservation{
        {static_cast<double>(P[0]), static_cast<double>(P[1]), static_cast<double>(P[2])},
        {460.0, 0.0, 460.0}};
  };
  ExpectRecovers(std::make_shared<BearingFamily>(), LandmarkKind::kPoint,
                 std::make_shared<PoseManifold>(), nullptr, 2, measure);
  ExpectRecovers(std::make_shared<BearingFamily>(LandmarkKind::kHomogeneous, Perturbation::kLeft),
                 LandmarkKind::kHomogeneous, std::make_shared<LeftPoseManifold>(),
                 std::make_shared<SphereManifold>(4), 2, measure);
}

// A window as VINS-Fusion's: features of the first frame's left camera, seen by its right one, and
// by both at the other poses; the right camera's place and the clocks' offset are estimated too.
class StereoWindow {
 public:
  using Views = BodyReprojectionFamily::Views;

  explicit StereoWindow(BodyReprojectionFamily::Error error)
      : pose_manifold_(std::make_shared<PoseManifold>()), random_(92) {
    scene.AddPoses(&graph, pose_manifold_, 2);
    left = graph.AddVariable(scene.cameras[0].data(), 7, Role::kFrame, pose_manifold_);
    graph.SetConstant(left, true);
    const std::vector<double> start = scene.Beside(scene.cameras[1], pose_manifold_.get(), 0.01);
    right = graph.AddVariable(start.data(), 7, Role::kFrame, pose_manifold_);
    const double no_offset = 0.0;
    offset = graph.AddVariable(&no_offset, 1, Role::kFrame);
    for (const Views views :
         {Views::kTwoPoses, Views::kTwoPosesTwoCameras, Views::kOnePoseTwoCameras}) {
      families_.push_back(graph.AddFamily(std::make_shared<BodyReprojectionFamily>(
          BodyReprojectionFamily::TimeOffset::kEstimated,
          BodyReprojectionFamily::Feature::kInverseDepth, views, error)));
    }
    for (int k = 0; k < kPoints; ++k) {
      AddFeature(k);
    }
  }

  static constexpr double kOffset = 0.03;
  Scene scene;
  FactorGraph graph;
  VariableId left, right, offset;
  std::vector<VariableId> depths;

 private:
  // Where a camera sees the feature by its clock, kOffset late, on the move.
  void Measure(const Vector3& P, double point[2], double velocity[2]) {
    for (std::size_t k = 0; k < 2; ++k) {
      velocity[k] = random_.Unit();
      point[k] = static_cast<double>(P[k] / P[2]) + kOffset * velocity[k];
    }
  }

  void AddFeature(int k) {
    const Vector3 anchor = scene.InCamera(0, 0, k);
    const double start = 1.2 / static_cast<double>(anchor[2]);
    depths.push_back(graph.AddVariable(&start, 1, Role::kLandmark));
    BodyReprojectionFamily::Measurement m;
    Measure(anchor, m.point_i, m.velocity_i);
    m.sqrt_information[0] = m.sqrt_information[2] = 460.0;
    for (int pose = 0; pose < kPoses; ++pose) {
      const VariableId j = scene.pose_ids[static_cast<std::size_t>(pose)];
      Measure(scene.InCamera(pose, 1, k), m.point_j, m.velocity_j);
      if (pose == 0) {
        graph.AddFactor(families_[2], m, {left, right, depths.back(), offset});
        continue;
      }
      graph.AddFactor(families_[1], m, {scene.pose_ids[0], j, left, right, depths.back(), offset});
      Measure(scene.InCamera(pose, 0, k), m.point_j, m.velocity_j);
      graph.AddFactor(families_[0], m, {scene.pose_ids[0], j, left, depths.back(), offset});
    }
  }

  std::shared_ptr<const Manifold> pose_manifold_;
  test::Random random_;
  std::vector<FamilyHandle<BodyReprojectionFamily>> families_;
};

TEST(VisualSolver, AStereoWindowOnThePlaneAndOnTheSphere) {
  for (const auto error :
       {BodyReprojectionFamily::Error::kPlane, BodyReprojectionFamily::Error::kUnitSphere}) {
    StereoWindow window(error);
    SolveIt(&window.graph);
    for (std::size_t i = 0; i < kPoses; ++i) {
      window.scene.ExpectTrue(window.graph, window.scene.pose_ids[i], window.scene.poses[i]);
    }
    window.scene.ExpectTrue(window.graph, window.right, window.scene.cameras[1]);
    window.scene.ExpectTrue(window.graph, window.offset, {StereoWindow::kOffset});
    for (int k = 0; k < kPoints; ++k) {
      const double inverse_depth = 1.0 / static_cast<double>(window.scene.InCamera(0, 0, k)[2]);
      window.scene.ExpectTrue(window.graph, window.depths[static_cast<std::size_t>(k)],
                              {inverse_depth});
    }
  }
}

}  // namespace
}  // namespace inceres
