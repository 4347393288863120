#pragma once

#include <cmath>
#include <cstddef>
#include <random>

#include "inceres/io/bal.h"
#include "inceres/io/g2o.h"
#include "tools/problems/bal_cost.h"

namespace inceres::tools {

/// Cameras on a line that all see all points of a box in front of them; perfect observations,
/// perturbed start values.
inline BalProblem SmallBal(int num_cameras = 4, int num_points = 30) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  BalProblem bal;
  bal.num_cameras = num_cameras;
  bal.num_points = num_points;
  for (int i = 0; i < num_cameras; ++i) {
    const double camera[] = {0.1 * uniform(random),
                             0.1 * uniform(random),
                             0.1 * uniform(random),
                             0.5 * i,
                             0.0,
                             -6.0,
                             500.0,
                             -0.05,
                             0.01};
    bal.cameras.insert(bal.cameras.end(), std::begin(camera), std::end(camera));
  }
  for (int i = 0; i < 3 * num_points; ++i) {
    bal.points.push_back(2.0 * uniform(random));
  }
  for (int p = 0; p < num_points; ++p) {
    for (int c = 0; c < num_cameras; ++c) {
      double projection[2];
      BalReprojectionError{{0.0, 0.0}}(bal.CameraData(c), bal.PointData(p), projection);
      bal.observations.push_back({c, p, projection[0], projection[1]});
    }
  }
  for (double& value : bal.points) {
    value += 0.01 * uniform(random);
  }
  return bal;
}

/// Poses on a circle, relative poses of neighbors and one loop; perfect measurements, perturbed
/// start values.
inline PoseGraph SmallPoseGraph(int dimension, int num_poses = 12) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-0.05, 0.05);
  PoseGraph graph;
  graph.dimension = dimension;
  const double step = 2.0 * M_PI / num_poses;
  for (int i = 0; i < num_poses; ++i) {
    graph.ids.push_back(i);
    const double angle = step * i;
    const double noise = i == 0 ? 0.0 : 1.0;
    if (dimension == 2) {
      const double pose[] = {5.0 * std::cos(angle) + noise * uniform(random),
                             5.0 * std::sin(angle) + noise * uniform(random),
                             std::remainder(angle + noise * uniform(random), 2.0 * M_PI)};
      graph.poses.insert(graph.poses.end(), std::begin(pose), std::end(pose));
    } else {
      const double half = 0.5 * (angle + noise * uniform(random));
      const double pose[] = {
          5.0 * std::cos(angle), 5.0 * std::sin(angle), noise * uniform(random), 0.0, 0.0,
          std::sin(half),        std::cos(half)};
      graph.poses.insert(graph.poses.end(), std::begin(pose), std::end(pose));
    }
  }
  for (int i = 0; i < num_poses; ++i) {
    PoseGraphEdge edge;
    edge.from = i;
    edge.to = (i + 1) % num_poses;
    const double x = 5.0 * std::cos(step) - 5.0;
    const double y = 5.0 * std::sin(step);
    if (dimension == 2) {
      edge.measurement = {x, y, step};
    } else {
      edge.measurement = {x, y, 0.0, 0.0, 0.0, std::sin(0.5 * step), std::cos(0.5 * step)};
    }
    const int d = graph.TangentSize();
    for (int k = 0; k < d; ++k) {
      edge.information[static_cast<std::size_t>(k * d + k)] = 4.0 + k;
    }
    graph.edges.push_back(edge);
  }
  return graph;
}

}  // namespace inceres::tools
