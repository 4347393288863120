#pragma once

#include <vector>

#include <Eigen/Core>

namespace inceres::tools {

/// Largest differences of two solutions after the freedom of gauge is removed; lengths are relative
/// to the scene's size.
struct GeometryDifference {
  double positions = 0.0;  ///< camera centers or pose translations, relative to the scene size
  double points = 0.0;     ///< landmarks, relative to the scene size; 0 without landmarks
  double rotations = 0.0;  ///< radians; pose graphs only
  double Largest() const;
};

/// Positions of one bundle-adjustment solution, in world coordinates.
struct SceneGeometry {
  std::vector<Eigen::Vector3d> centers;  ///< camera centers
  std::vector<Eigen::Vector3d> points;
};

/// Robust measure of how large a scene is: the median distance of centers and points from their
/// component-wise median.
double SceneSize(const SceneGeometry& scene);

/// Aligns `scene` to `reference` by the similarity (rotation, translation, scale) that is best in
/// the least-squares sense, then takes the largest remaining differences. Points further than ten
/// scene sizes from the middle do not vote on the alignment, which they would dominate though they
/// are the least certain; they do count in the difference. Needs three or more positions in all.
/// Source: Umeyama, "Least-squares estimation of transformation parameters between two point
/// patterns", 1991.
GeometryDifference DifferenceUpToSimilarity(const SceneGeometry& scene,
                                            const SceneGeometry& reference);

}  // namespace inceres::tools
