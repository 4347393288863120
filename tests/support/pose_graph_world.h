#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "inceres/io/g2o.h"
#include "inceres/problem/rotation.h"

namespace inceres::test {

/// Poses along rounds of a square, with odometry, a loop from each pose to the one a round before,
/// and wrong loops last; measured with noise of standard deviation `sigma`, meters and radians,
/// which is also what the information says.
struct PoseGraphWorld {
  PoseGraph truth;  ///< poses where they belong, edges as measured
  int num_right = 0;
  int num_wrong = 0;

  PoseGraphWorld(int dimension, int num_poses, int round, int num_wrong_loops, double sigma,
                 unsigned seed)
      : num_wrong(num_wrong_loops), engine_(seed), sigma_(sigma) {
    truth.dimension = dimension;
    for (int i = 0; i < num_poses; ++i) {
      AddPose(i, round);
    }
    for (int i = 1; i < num_poses; ++i) {
      Measure(i - 1, i);
    }
    for (int i = round; i < num_poses; ++i) {
      Measure(i - round, i);
      ++num_right;
    }
    for (int k = 0; k < num_wrong; ++k) {
      AddWrongLoop(round);
    }
  }

  /// Everything at the origin, the first pose at its place.
  PoseGraph WithoutPlaces() const {
    PoseGraph lost = truth;
    for (int i = 1; i < lost.NumVertices(); ++i) {
      std::copy_n(lost.PoseData(0), lost.PoseSize(), lost.PoseData(i));
    }
    return lost;
  }

  /// The largest distance of two vertices of the same index.
  static double LargestDistance(const PoseGraph& a, const PoseGraph& b) {
    double largest = 0.0;
    for (int i = 0; i < a.NumVertices(); ++i) {
      double sum = 0.0;
      for (int k = 0; k < a.dimension; ++k) {
        const double difference = a.PoseData(i)[k] - b.PoseData(i)[k];
        sum += difference * difference;
      }
      largest = std::max(largest, std::sqrt(sum));
    }
    return largest;
  }

 private:
  void AddPose(int i, int round) {
    const double angle = 2.0 * M_PI * i / round;
    const double up = 0.1 * i / round;
    truth.ids.push_back(10 * i);
    if (truth.dimension == 2) {
      truth.poses.insert(truth.poses.end(),
                         {10.0 * std::cos(angle) + up, 10.0 * std::sin(angle), angle + M_PI / 2});
      return;
    }
    const double phi[3] = {0.3 * std::sin(angle), 0.2 * std::cos(angle), angle};
    double q[4];
    ExpQuaternion(phi, q);
    truth.poses.insert(truth.poses.end(), {10.0 * std::cos(angle), 10.0 * std::sin(angle), up, q[0],
                                           q[1], q[2], q[3]});
  }

  std::array<double, 7> MotionOf(int from, int to) const {
    double inverse[7];
    std::array<double, 7> motion{};
    const bool planar = truth.dimension == 2;
    (planar ? InvertPlanarPose : InvertPose)(truth.PoseData(from), inverse);
    (planar ? ComposePlanarPoses : ComposePoses)(inverse, truth.PoseData(to), motion.data());
    return motion;
  }

  double Noise() { return sigma_ * std::normal_distribution<double>()(engine_); }

  PoseGraphEdge NewEdge(int from, int to) {
    PoseGraphEdge edge;
    edge.from = from;
    edge.to = to;
    const int size = truth.TangentSize();
    const double weight = sigma_ > 0.0 ? 1.0 / (sigma_ * sigma_) : 1.0;
    for (int k = 0; k < size; ++k) {
      edge.information[static_cast<std::size_t>(k * size + k)] = weight;
    }
    return edge;
  }

  void Measure(int from, int to) {
    PoseGraphEdge edge = NewEdge(from, to);
    edge.measurement = MotionOf(from, to);
    for (std::size_t k = 0; k < static_cast<std::size_t>(truth.dimension); ++k) {
      edge.measurement[k] += Noise();
    }
    if (truth.dimension == 2) {
      edge.measurement[2] += Noise();
    } else {
      const double phi[3] = {Noise(), Noise(), Noise()};
      double turn[4], q[4];
      ExpQuaternion(phi, turn);
      MultiplyQuaternions(edge.measurement.data() + 3, turn, q);
      std::copy_n(q, 4, edge.measurement.data() + 3);
    }
    truth.edges.push_back(edge);
  }

  void AddWrongLoop(int round) {
    const int count = truth.NumVertices();
    const int from = static_cast<int>(engine_() % static_cast<unsigned>(count - round / 2));
    const int apart = round / 4 + static_cast<int>(engine_() % static_cast<unsigned>(round / 4));
    PoseGraphEdge edge = NewEdge(from, std::min(from + apart, count - 1));
    edge.measurement = MotionOf(0, round);  // as of the same place, a round later
    truth.edges.push_back(edge);
  }

  std::mt19937 engine_;
  double sigma_;
};

}  // namespace inceres::test
