#include "clients/scenes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>

#include <ceres/rotation.h>

namespace clients {
namespace {

constexpr double kArc = 1.5;  // radians
constexpr double kDistance = 10.0;

template <typename T>
void Project(const T* camera_point, const T* intrinsics, const double* observed, T* residuals) {
  const T x = camera_point[0] / camera_point[2];
  const T y = camera_point[1] / camera_point[2];
  const T distortion = 1.0 + intrinsics[3] * (x * x + y * y);
  residuals[0] = intrinsics[0] * distortion * x + intrinsics[1] - observed[0];
  residuals[1] = intrinsics[0] * distortion * y + intrinsics[2] - observed[1];
}

struct PoseError {
  double observed[2];
  template <typename T>
  bool operator()(const T* pose, const T* intrinsics, const T* point, T* residuals) const {
    T in_camera[3];
    ceres::AngleAxisRotatePoint(pose, point, in_camera);
    for (int k = 0; k < 3; ++k) {
      in_camera[k] += pose[3 + k];
    }
    Project(in_camera, intrinsics, observed, residuals);
    return true;
  }
};

struct ScaledPoseError {
  PoseError error;
  template <typename T>
  bool operator()(T const* const* blocks, T* residuals) const {
    const T scaled[3] = {blocks[3][0] * blocks[2][0], blocks[3][0] * blocks[2][1],
                         blocks[3][0] * blocks[2][2]};
    return error(blocks[0], blocks[1], scaled, residuals);
  }
};

struct QuaternionError {
  double observed[2];
  template <typename T>
  bool operator()(const T* rotation, const T* translation, const T* point, const T* intrinsics,
                  T* residuals) const {
    T in_camera[3];
    ceres::QuaternionRotatePoint(rotation, point, in_camera);
    for (int k = 0; k < 3; ++k) {
      in_camera[k] += translation[k];
    }
    Project(in_camera, intrinsics, observed, residuals);
    return true;
  }
};

struct PlanarError {
  RelativePose measured;
  template <typename T>
  bool operator()(const T* a, const T* b, T* residuals) const {
    return (*this)(a, a + 1, a + 2, b, b + 1, b + 2, residuals);
  }
  template <typename T>
  bool operator()(const T* xa, const T* ya, const T* ta, const T* xb, const T* yb, const T* tb,
                  T* residuals) const {
    using std::cos;
    using std::floor;
    using std::sin;
    const T dx = *xb - *xa;
    const T dy = *yb - *ya;
    residuals[0] = 20.0 * (cos(*ta) * dx + sin(*ta) * dy - measured.difference[0]);
    residuals[1] = 20.0 * (cos(*ta) * dy - sin(*ta) * dx - measured.difference[1]);
    const T turn = *tb - *ta - measured.difference[2];
    residuals[2] = 50.0 * (turn - 2.0 * M_PI * floor((turn + M_PI) / (2.0 * M_PI)));
    return true;
  }
};

}  // namespace

Reconstruction::Reconstruction(int num_cameras, int num_points, int track_length,
                               double outlier_fraction)
    : intrinsics{1000.0, 320.0, 240.0, -0.05} {
  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for (int i = 0; i < num_cameras; ++i) {
    poses.push_back({0.05 * uniform(random), kArc * i / num_cameras, 0.05 * uniform(random),
                     0.2 * uniform(random), 0.2 * uniform(random), kDistance});
  }
  for (int j = 0; j < num_points; ++j) {
    points.push_back({3.0 * uniform(random), 3.0 * uniform(random), 3.0 * uniform(random)});
    const int first = static_cast<int>(random() % static_cast<unsigned>(num_cameras));
    for (int k = 0; k < track_length; ++k) {
      const int camera = std::min(first, num_cameras - track_length) + k;
      const double zero[2] = {0.0, 0.0};
      double seen[2];
      PoseError{{zero[0], zero[1]}}(poses[static_cast<std::size_t>(camera)].data(),
                                    intrinsics.data(), points.back().data(), seen);
      const bool wrong = 0.5 * (uniform(random) + 1.0) < outlier_fraction;
      const double spread = wrong ? 30.0 : 0.5;
      observations.push_back(
          {camera, j, seen[0] + spread * normal(random), seen[1] + spread * normal(random)});
    }
  }
  for (std::size_t i = 1; i < poses.size(); ++i) {
    for (std::size_t k = 0; k < 6; ++k) {
      poses[i][k] += (k < 3 ? 0.005 : 0.05) * normal(random);
    }
  }
  for (auto& point : points) {
    for (double& value : point) {
      value += 0.05 * normal(random);
    }
  }
  intrinsics[0] *= 1.01;
  for (const auto& pose : poses) {
    ceres::AngleAxisToQuaternion(pose.data(), rotations.emplace_back().data());
    translations.push_back({pose[3], pose[4], pose[5]});
  }
}

ceres::CostFunction* PoseReprojection(const Observation& o) {
  return new ceres::AutoDiffCostFunction<PoseError, 2, 6, 4, 3>(new PoseError{{o.x, o.y}});
}

ceres::CostFunction* ScaledReprojection(const Observation& o) {
  auto* cost =
      new ceres::DynamicAutoDiffCostFunction<ScaledPoseError, 4>(new ScaledPoseError{{{o.x, o.y}}});
  for (const int size : {6, 4, 3, 1}) {
    cost->AddParameterBlock(size);
  }
  cost->SetNumResiduals(2);
  return cost;
}

ceres::CostFunction* NumericReprojection(const Observation& o) {
  return new ceres::NumericDiffCostFunction<PoseError, ceres::CENTRAL, 2, 6, 4, 3>(
      new PoseError{{o.x, o.y}});
}

ceres::CostFunction* QuaternionReprojection(const Observation& o) {
  return new ceres::AutoDiffCostFunction<QuaternionError, 2, 4, 3, 3, 4>(
      new QuaternionError{{o.x, o.y}});
}

PlanarGraph::PlanarGraph(int num_poses) {
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  std::vector<std::array<double, 3>> truth;
  for (int i = 0; i < num_poses; ++i) {
    const double s = 0.05 * i;
    truth.push_back({8.0 * std::sin(s), 4.0 * std::sin(2.0 * s), 0.3 * s});
  }
  const auto connect = [&](int a, int b) {
    const auto& from = truth[static_cast<std::size_t>(a)];
    const auto& to = truth[static_cast<std::size_t>(b)];
    const double c = std::cos(from[2]), s = std::sin(from[2]);
    const double dx = to[0] - from[0], dy = to[1] - from[1];
    constraints.push_back(
        {a,
         b,
         {c * dx + s * dy + 0.02 * normal(random), c * dy - s * dx + 0.02 * normal(random),
          to[2] - from[2] + 0.005 * normal(random)}});
  };
  for (int i = 1; i < num_poses; ++i) {
    connect(i - 1, i);
    for (int back = 126; back <= i && i % 7 == 0; back += 126) {
      connect(i - back, i);
    }
  }
  for (const auto& pose : truth) {
    poses.push_back({pose[0] + 0.1 * normal(random), pose[1] + 0.1 * normal(random),
                     pose[2] + 0.02 * normal(random)});
  }
  poses[0] = truth[0];
}

ceres::CostFunction* PlanarConstraint(const RelativePose& constraint) {
  return new ceres::AutoDiffCostFunction<PlanarError, 3, 3, 3>(new PlanarError{constraint});
}

ceres::CostFunction* ScalarConstraint(const RelativePose& constraint) {
  return new ceres::AutoDiffCostFunction<PlanarError, 3, 1, 1, 1, 1, 1, 1>(
      new PlanarError{constraint});
}

}  // namespace clients
