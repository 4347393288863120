#include <algorithm>
#include <cstddef>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <ceres/autodiff_cost_function.h>
#include <ceres/rotation.h>
#include <gtest/gtest.h>

#include "integration/problems.h"
#include "tools/problems/bal_cost.h"
#include "tools/problems/ceres_loss.h"
#include "tools/sim/street_scene.h"

namespace inceres::test {
namespace {

constexpr std::ptrdiff_t kCameraSize = BalProblem::kCameraSize;

// A BAL camera and a homogeneous point X: P = R X.xyz + t X.w, whose projection does not depend on
// the length of X.
struct HomogeneousReprojectionError {
  double observed[2];

  template <typename T>
  bool operator()(const T* camera, const T* X, T* residuals) const {
    T P[3];
    ceres::AngleAxisRotatePoint(camera, X, P);
    for (int k = 0; k < 3; ++k) {
      P[k] += camera[3 + k] * X[3];
    }
    tools::BalResidual(P, camera + 6, observed, residuals);
    return true;
  }
};

struct UnitLength {
  template <typename T>
  bool operator()(const T* X, T* residual) const {
    residual[0] = 10.0 * (X[0] * X[0] + X[1] * X[1] + X[2] * X[2] + X[3] * X[3] - 1.0);
    return true;
  }
};

void Hold(Gauge gauge, int camera_size, Instance* instance) {
  for (int i = 0; i < 2 && gauge == Gauge::kTwoCamerasConstant; ++i) {
    instance->problem->SetParameterBlockConstant(instance->x.data() +
                                                 std::ptrdiff_t{i} * camera_size);
  }
}

}  // namespace

BalProblem SmallStreet(unsigned seed, double start_noise) {
  StreetSceneOptions options;
  options.num_cameras = 8;
  options.num_points = 320;
  options.num_observations = 1280;
  options.rotation_noise *= start_noise;
  options.position_noise *= start_noise;
  options.point_noise *= start_noise;
  options.seed = seed;
  StreetScene scene;
  const Status generated = GenerateStreetScene(options, &scene);
  EXPECT_TRUE(generated.ok()) << generated.message;
  std::copy_n(scene.truth.cameras.begin(), 2 * kCameraSize, scene.problem.cameras.begin());
  return scene.problem;
}

BalProblem BundledBal(const std::string& name) {
  BalProblem bal;
  const Status read = ReadBal(INCERES_SOURCE_DIR "/bal_data/" + name, &bal);
  EXPECT_TRUE(read.ok()) << read.message;
  return bal;
}

std::unique_ptr<Instance> MakeBal(const BalProblem& bal, tools::BalCameraModel model, Gauge gauge,
                                  const tools::LossSpec& loss) {
  auto instance = std::make_unique<Instance>();
  instance->x = tools::CamerasIn(bal, model);
  const auto first_point = static_cast<std::ptrdiff_t>(instance->x.size());
  instance->x.insert(instance->x.end(), bal.points.begin(), bal.points.end());
  double* cameras = instance->x.data();
  double* points = cameras + first_point;
  instance->problem = tools::BuildBalCeresProblem(bal, loss, cameras, points, model);
  for (std::ptrdiff_t j = 0; j < bal.num_points; ++j) {
    if (instance->problem->HasParameterBlock(points + 3 * j)) {
      instance->landmarks.push_back(points + 3 * j);
    }
  }
  Hold(gauge, tools::CameraSize(model), instance.get());
  return instance;
}

std::unique_ptr<Instance> MakeHomogeneous(const BalProblem& bal, Gauge gauge,
                                          const tools::LossSpec& loss) {
  auto instance = std::make_unique<Instance>();
  instance->x = bal.cameras;
  for (int j = 0; j < bal.num_points; ++j) {
    const Eigen::Vector4d X =
        Eigen::Map<const Eigen::Vector3d>(bal.PointData(j)).homogeneous().normalized();
    instance->x.insert(instance->x.end(), X.data(), X.data() + 4);
  }
  double* cameras = instance->x.data();
  double* points = cameras + bal.cameras.size();
  instance->problem = std::make_unique<ceres::Problem>();
  ceres::LossFunction* shared_loss = tools::MakeCeresLoss(loss).release();  // owned by the problem
  for (const BalObservation& observation : bal.observations) {
    auto* error = new HomogeneousReprojectionError{{observation.x, observation.y}};
    instance->problem->AddResidualBlock(
        new ceres::AutoDiffCostFunction<HomogeneousReprojectionError, 2, 9, 4>(error), shared_loss,
        cameras + kCameraSize * observation.camera, points + std::ptrdiff_t{4} * observation.point);
  }
  for (std::ptrdiff_t j = 0; j < bal.num_points; ++j) {
    instance->problem->AddResidualBlock(
        new ceres::AutoDiffCostFunction<UnitLength, 1, 4>(new UnitLength), nullptr, points + 4 * j);
    instance->landmarks.push_back(points + 4 * j);
  }
  Hold(gauge, BalProblem::kCameraSize, instance.get());
  return instance;
}

}  // namespace inceres::test
