#include "tools/problems/gauge.h"

#include <algorithm>
#include <cassert>
#include <cstddef>

#include <Eigen/Geometry>

namespace inceres::tools {
namespace {

using Eigen::Vector3d;

double MedianInPlace(std::vector<double>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
}

std::vector<Vector3d> AllPositions(const SceneGeometry& scene) {
  std::vector<Vector3d> positions = scene.centers;
  positions.insert(positions.end(), scene.points.begin(), scene.points.end());
  return positions;
}

Vector3d MedianPosition(const std::vector<Vector3d>& positions) {
  Vector3d median;
  std::vector<double> values(positions.size());
  for (int axis = 0; axis < 3; ++axis) {
    std::transform(positions.begin(), positions.end(), values.begin(),
                   [axis](const Vector3d& p) { return p[axis]; });
    median[axis] = MedianInPlace(&values);
  }
  return median;
}

double MedianDistance(const std::vector<Vector3d>& positions, const Vector3d& middle) {
  std::vector<double> distances(positions.size());
  std::transform(positions.begin(), positions.end(), distances.begin(),
                 [&](const Vector3d& p) { return (p - middle).norm(); });
  return MedianInPlace(&distances);
}

double LargestDistance(const std::vector<Vector3d>& from, const std::vector<Vector3d>& to,
                       const Eigen::Matrix4d& similarity) {
  double largest = 0.0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Vector3d aligned =
        similarity.topLeftCorner<3, 3>() * from[i] + similarity.topRightCorner<3, 1>();
    largest = std::max(largest, (aligned - to[i]).norm());
  }
  return largest;
}

}  // namespace

double GeometryDifference::Largest() const {
  return std::max({positions, points, rotations});
}

double SceneSize(const SceneGeometry& scene) {
  const std::vector<Vector3d> positions = AllPositions(scene);
  assert(!positions.empty());
  return MedianDistance(positions, MedianPosition(positions));
}

GeometryDifference DifferenceUpToSimilarity(const SceneGeometry& scene,
                                            const SceneGeometry& reference) {
  assert(scene.centers.size() == reference.centers.size() &&
         scene.points.size() == reference.points.size());
  const std::vector<Vector3d> from = AllPositions(scene);
  const std::vector<Vector3d> to = AllPositions(reference);
  assert(from.size() >= 3);
  const Vector3d middle = MedianPosition(to);
  const double size = MedianDistance(to, middle);

  std::vector<std::size_t> voters;
  for (std::size_t i = 0; i < to.size(); ++i) {
    if (i < reference.centers.size() || (to[i] - middle).norm() <= 10.0 * size) {
      voters.push_back(i);
    }
  }
  Eigen::Matrix3Xd source(3, static_cast<Eigen::Index>(voters.size()));
  Eigen::Matrix3Xd target(3, static_cast<Eigen::Index>(voters.size()));
  for (std::size_t k = 0; k < voters.size(); ++k) {
    source.col(static_cast<Eigen::Index>(k)) = from[voters[k]];
    target.col(static_cast<Eigen::Index>(k)) = to[voters[k]];
  }
  const Eigen::Matrix4d similarity = Eigen::umeyama(source, target);

  GeometryDifference difference;
  difference.positions = LargestDistance(scene.centers, reference.centers, similarity) / size;
  difference.points = LargestDistance(scene.points, reference.points, similarity) / size;
  return difference;
}

}  // namespace inceres::tools
