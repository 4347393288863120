#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <random>

#include "inceres/io/g2o.h"
#include "inceres/io/stereo_odometry.h"
#include "inceres/problem/rotation.h"

namespace inceres::tools {

/// A walk in space or in the plane with noisy relative poses: of each pose with the two before and,
/// of every fifth, with the first of all; edges point either way. Ids have gaps and stand in
/// reverse. The values are those of the true walk; information matrices are full.
inline PoseGraph NoisyPoseGraph(int dimension, int num_poses) {
  std::mt19937 random(23);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  PoseGraph graph;
  graph.dimension = dimension;
  const auto size = static_cast<std::size_t>(graph.PoseSize());
  const auto near = [&](double length, double turn) {
    std::array<double, 7> motion{length, 0.1 * turn, turn, 0.0, 0.0, 0.0, 1.0};
    if (dimension == 3) {
      const double phi[3] = {0.3 * turn, -0.2 * turn, turn};
      ExpQuaternion(phi, motion.data() + 3);
    }
    return motion;
  };
  const auto compose = [&](const double* a, const double* b) {
    std::array<double, 7> c{};
    (dimension == 2 ? ComposePlanarPoses : ComposePoses)(a, b, c.data());
    return c;
  };
  std::vector<std::array<double, 7>> truth = {{0.3, -0.2, 0.1, 0.0, 0.0, 0.0, 1.0}};
  for (int i = 1; i < num_poses; ++i) {
    truth.push_back(compose(truth.back().data(), near(1.0, 0.5 + 0.1 * uniform(random)).data()));
  }
  for (int i = num_poses - 1; i >= 0; --i) {
    graph.ids.push_back(3 * i + 1);
    const auto& pose = truth[static_cast<std::size_t>(i)];
    graph.poses.insert(graph.poses.end(), pose.begin(),
                       pose.begin() + static_cast<std::ptrdiff_t>(size));
  }
  const auto add_edge = [&](int from, int to) {
    PoseGraphEdge edge;
    edge.from = num_poses - 1 - from;
    edge.to = num_poses - 1 - to;
    std::array<double, 7> back{};
    (dimension == 2 ? InvertPlanarPose : InvertPose)(truth[static_cast<std::size_t>(from)].data(),
                                                     back.data());
    const std::array<double, 7> motion =
        compose(back.data(), truth[static_cast<std::size_t>(to)].data());
    edge.measurement =
        compose(motion.data(), near(0.03 * uniform(random), 0.02 * uniform(random)).data());
    const int d = graph.TangentSize();
    for (int r = 0; r < d; ++r) {
      for (int c = 0; c <= r; ++c) {
        const double value = r == c ? 50.0 + 10.0 * r : 4.0 * uniform(random);
        edge.information[static_cast<std::size_t>(r * d + c)] =
            edge.information[static_cast<std::size_t>(c * d + r)] = value;
      }
    }
    graph.edges.push_back(edge);
  };
  for (int i = 1; i < num_poses; ++i) {
    add_edge(i - 1, i);
    if (i > 1) {
      add_edge(i, i - 2);
    }
    if (i > 2 && i % 5 == 0) {
      add_edge(0, i);
    }
  }
  return graph;
}

/// A stereo camera that drives a bend past points which each pose sees six new ones of and the next
/// three see again; pose 14 sees the points of pose 0 once more. Half a pixel of noise on the
/// sightings, a little on the odometry.
inline StereoOdometry SmallStereo(int num_poses) {
  std::mt19937 random(29);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  StereoOdometry odometry;
  odometry.camera = {500.0, 510.0, 320.0, 240.0, 0.4};
  std::array<double, 7> pose{0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0};
  std::vector<std::array<double, 3>> points;
  for (int i = 0; i < num_poses; ++i) {
    std::array<double, 7> noisy = pose;
    for (std::size_t k = 0; k < 3; ++k) {
      noisy[k] += i > 0 ? 0.01 * uniform(random) : 0.0;
    }
    odometry.poses.push_back(noisy);
    for (int p = 0; p < 6; ++p) {
      const double in_camera[3] = {2.0 * uniform(random), uniform(random),
                                   5.0 + 2.0 * uniform(random)};
      TransformPoint(pose.data(), in_camera, points.emplace_back().data());
      odometry.point_ids.push_back(100 + 7 * static_cast<int>(points.size()));
    }
    double back[7];
    InvertPose(pose.data(), back);
    const int all = static_cast<int>(points.size());
    for (int p = 0; p < all; ++p) {
      if (p < std::max(0, 6 * (i - 3)) && !(i == 14 && p < 6)) {
        continue;
      }
      StereoSighting sighting;
      sighting.pose = i;
      sighting.point = p;
      double X[3];
      TransformPoint(back, points[static_cast<std::size_t>(p)].data(), X);
      const double u = 500.0 * X[0] / X[2] + 320.0;
      sighting.left[0] = u + 0.5 * uniform(random);
      sighting.left[1] = 510.0 * X[1] / X[2] + 240.0 + 0.5 * uniform(random);
      sighting.right_u = u - 500.0 * 0.4 / X[2] + 0.5 * uniform(random);
      const double depth = 200.0 / (sighting.left[0] - sighting.right_u);
      sighting.in_camera[0] = (sighting.left[0] - 320.0) / 500.0 * depth;
      sighting.in_camera[1] = (sighting.left[1] - 240.0) / 510.0 * depth;
      sighting.in_camera[2] = depth;
      odometry.sightings.push_back(sighting);
    }
    const double phi[3] = {0.0, 0.05, 0.01};
    std::array<double, 7> step{0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 1.0}, next{};
    ExpQuaternion(phi, step.data() + 3);
    ComposePoses(pose.data(), step.data(), next.data());
    pose = next;
  }
  return odometry;
}

}  // namespace inceres::tools
