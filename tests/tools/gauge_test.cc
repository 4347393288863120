#include "tools/problems/gauge.h"

#include <random>

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace inceres::tools {
namespace {

using Eigen::Vector3d;

SceneGeometry RandomScene() {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  SceneGeometry scene;
  for (int i = 0; i < 8; ++i) {
    scene.centers.emplace_back(uniform(random), uniform(random), uniform(random));
  }
  for (int i = 0; i < 50; ++i) {
    scene.points.emplace_back(3.0 * uniform(random), uniform(random), uniform(random));
  }
  return scene;
}

SceneGeometry Moved(SceneGeometry scene) {
  const Eigen::Matrix3d rotation =
      Eigen::AngleAxisd(2.1, Vector3d(1.0, -2.0, 0.5).normalized()).toRotationMatrix();
  for (auto* positions : {&scene.centers, &scene.points}) {
    for (Vector3d& X : *positions) {
      X = 4.5 * (rotation * X) + Vector3d(10.0, -20.0, 30.0);
    }
  }
  return scene;
}

TEST(DifferenceUpToSimilarity, VanishesForAMovedScene) {
  const SceneGeometry scene = RandomScene();
  const GeometryDifference difference = DifferenceUpToSimilarity(Moved(scene), scene);
  EXPECT_LT(difference.Largest(), 1e-13);
}

TEST(DifferenceUpToSimilarity, SeesOneDisplacedPointAndOneDisplacedCamera) {
  const SceneGeometry scene = RandomScene();
  const double size = SceneSize(scene);
  SceneGeometry point_off = scene;
  point_off.points[3].x() += 1e-3 * size;
  const GeometryDifference point = DifferenceUpToSimilarity(Moved(point_off), scene);
  EXPECT_NEAR(point.points, 1e-3, 1e-4);
  EXPECT_LT(point.positions, 3e-4);
  SceneGeometry camera_off = scene;
  camera_off.centers[2].z() += 1e-3 * size;
  const GeometryDifference camera = DifferenceUpToSimilarity(Moved(camera_off), scene);
  EXPECT_NEAR(camera.positions, 1e-3, 1e-4);
  EXPECT_LT(camera.points, 3e-4);
}

TEST(DifferenceUpToSimilarity, FarPointsDoNotVoteButCount) {
  SceneGeometry scene = RandomScene();
  scene.points.emplace_back(1e4, 0.0, 0.0);
  SceneGeometry other = scene;
  other.points.back().y() += 100.0;  // would tilt the whole scene if it took part in the alignment
  const GeometryDifference difference = DifferenceUpToSimilarity(other, scene);
  EXPECT_LT(difference.positions, 1e-12);
  EXPECT_NEAR(difference.points, 100.0 / SceneSize(scene), 1e-6);
}

TEST(DifferenceUpToSimilarity, AMirroredSceneIsDifferent) {
  SceneGeometry mirrored = RandomScene();
  for (auto* positions : {&mirrored.centers, &mirrored.points}) {
    for (Vector3d& X : *positions) {
      X.x() = -X.x();
    }
  }
  EXPECT_GT(DifferenceUpToSimilarity(mirrored, RandomScene()).Largest(), 0.1);
}

TEST(SceneSize, IgnoresFarPoints) {
  SceneGeometry scene = RandomScene();
  const double size = SceneSize(scene);
  scene.points.emplace_back(1e6, 1e6, 1e6);
  EXPECT_NEAR(SceneSize(scene), size, 0.1 * size);
}

}  // namespace
}  // namespace inceres::tools
