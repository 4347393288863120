#include "adapters/test_problems.h"

#include <cmath>

#include <ceres/rotation.h>
#include <ceres/version.h>

#include "support/classic_functors.h"
#include "support/closed_curve.h"

namespace inceres::testing {
namespace {

using test::ExponentialTerm;
using test::PowellTerm;

struct Reprojection {
  double u, v;
  template <typename T>
  bool operator()(const T* camera, const T* point, T* residual) const {
    T p[3];
    ceres::AngleAxisRotatePoint(camera, point, p);
    const T x = (p[0] + camera[3]) / (p[2] + camera[5]);
    const T y = (p[1] + camera[4]) / (p[2] + camera[5]);
    const T r2 = x * x + y * y;
    const T scale = camera[6] * (1.0 + r2 * (camera[7] + camera[8] * r2));
    residual[0] = scale * x - u;
    residual[1] = scale * y - v;
    return true;
  }
};

// world_from_body: p, q (x y z w); point given by a bearing in body i and its inverse depth, seen
// from body j.
struct InverseDepthReprojection {
  double bearing_i[2], bearing_j[2];
  template <typename T>
  bool operator()(const T* pose_i, const T* pose_j, const T* extrinsic, const T* inverse_depth,
                  T* residual) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const auto rotation = [](const T* pose) {
      return Eigen::Map<const Eigen::Quaternion<T>>(pose + 3);
    };
    const auto translation = [](const T* pose) { return Eigen::Map<const Vector>(pose); };
    const Vector camera_i = Vector(T(bearing_i[0]), T(bearing_i[1]), T(1.0)) / inverse_depth[0];
    const Vector body_i = rotation(extrinsic) * camera_i + translation(extrinsic);
    const Vector world = rotation(pose_i) * body_i + translation(pose_i);
    const Vector body_j = rotation(pose_j).conjugate() * (world - translation(pose_j));
    const Vector camera_j = rotation(extrinsic).conjugate() * (body_j - translation(extrinsic));
    residual[0] = 300.0 * (camera_j[0] / camera_j[2] - bearing_j[0]);
    residual[1] = 300.0 * (camera_j[1] / camera_j[2] - bearing_j[1]);
    return true;
  }
};

// A linear prior over poses and velocities, dense and of run-time size: r = Σ_k A_k (x_k − x⁰_k).
ceres::CostFunction* DensePrior(int num_residuals,
                                const std::vector<std::vector<double>>& origins) {
  std::vector<int> sizes;
  for (const std::vector<double>& origin : origins) {
    sizes.push_back(static_cast<int>(origin.size()));
  }
  return new lambdas::Formula(
      num_residuals, sizes, [=](double const* const* x, double* residuals, double** jacobians) {
        std::fill_n(residuals, num_residuals, 0.0);
        for (std::size_t k = 0; k < sizes.size(); ++k) {
          for (int r = 0; r < num_residuals; ++r) {
            for (int c = 0; c < sizes[k]; ++c) {
              const double a =
                  0.3 * std::cos(1.0 + 7.0 * static_cast<double>(k) + 3.0 * r + 1.7 * c) +
                  (r % 9 == c ? 2.0 : 0.0);
              residuals[r] += a * (x[k][c] - origins[k][static_cast<std::size_t>(c)]);
              jacobians[k][r * sizes[k] + c] = a;
            }
          }
        }
        return true;
      });
}

double Uniform(std::mt19937* engine, double low, double high) {
  return low +
         (high - low) * static_cast<double>((*engine)()) / static_cast<double>(std::mt19937::max());
}

std::vector<double> PoseOf(int i) {
  const Eigen::Quaterniond q(
      Eigen::AngleAxisd(0.05 * i, Eigen::Vector3d(0.2, 1.0, 0.1).normalized()));
  return {0.4 * i, 0.05 * i * i, 0.1 * std::sin(i), q.x(), q.y(), q.z(), q.w()};
}

#if CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR < 2
ceres::LocalParameterization* MakePoseParameterization() {
  return new ceres::ProductParameterization(new ceres::IdentityParameterization(3),
                                            new ceres::EigenQuaternionParameterization());
}
#else
ceres::Manifold* MakePoseParameterization() {
  return new ceres::ProductManifold<ceres::EuclideanManifold<3>, ceres::EigenQuaternionManifold>();
}
#endif

Eigen::Vector3d InCamera(const std::vector<double>& pose, const std::vector<double>& extrinsic,
                         const Eigen::Vector3d& world) {
  const auto rotation = [](const std::vector<double>& x) {
    return Eigen::Quaterniond(x[6], x[3], x[4], x[5]);
  };
  const auto translation = [](const std::vector<double>& x) {
    return Eigen::Vector3d(x[0], x[1], x[2]);
  };
  const Eigen::Vector3d body = rotation(pose).conjugate() * (world - translation(pose));
  return rotation(extrinsic).conjugate() * (body - translation(extrinsic));
}

void AddFeatures(int num_features, bool huber, const std::vector<double*>& poses, double* extrinsic,
                 std::mt19937* engine, TestProblem* test) {
  const std::vector<double> true_extrinsic(extrinsic, extrinsic + 7);
  ceres::LossFunction* loss = huber ? new ceres::HuberLoss(1.0) : nullptr;
  const int num_poses = static_cast<int>(poses.size());
  for (int f = 0; f < num_features; ++f) {
    const Eigen::Vector3d world(Uniform(engine, -2, 4), Uniform(engine, -2, 2),
                                Uniform(engine, 4, 9));
    const int anchor = f % (num_poses - 1);
    const Eigen::Vector3d seen = InCamera(PoseOf(anchor), true_extrinsic, world);
    double* inverse_depth = test->Add({1.0 / seen.z() * Uniform(engine, 0.8, 1.2)});
    for (int j = anchor + 1; j < num_poses; ++j) {
      const Eigen::Vector3d other = InCamera(PoseOf(j), true_extrinsic, world);
      auto* term = new InverseDepthReprojection{
          {seen.x() / seen.z(), seen.y() / seen.z()},
          {other.x() / other.z() + Uniform(engine, -2e-3, 2e-3), other.y() / other.z()}};
      auto* cost = new ceres::AutoDiffCostFunction<InverseDepthReprojection, 2, 7, 7, 7, 1>(term);
      test->problem.AddResidualBlock(cost, loss, poses[static_cast<std::size_t>(anchor)],
                                     poses[static_cast<std::size_t>(j)], extrinsic, inverse_depth);
    }
  }
  if (num_features == 0) {
    delete loss;
  }
}

}  // namespace

TargetCost::TargetCost(const std::vector<double>& target, const Function& hook)
    : Cost(static_cast<int>(target.size()), {static_cast<int>(target.size())},
           [=](double const* const* x, double* residuals, double** jacobians) {
             const std::size_t size = target.size();
             for (std::size_t i = 0; i < size; ++i) {
               residuals[i] = x[0][i] - target[i];
             }
             if (jacobians != nullptr && jacobians[0] != nullptr) {
               for (std::size_t k = 0; k < size * size; ++k) {
                 jacobians[0][k] = k / size == k % size ? 1.0 : 0.0;
               }
             }
             return hook == nullptr || hook(x, residuals, jacobians);
           }) {
}

std::unique_ptr<TestProblem> MakePowell() {
  auto test = std::make_unique<TestProblem>();
  for (const double start : PowellTerm::kStart) {
    test->Add({start});
  }
  for (int term = 0; term < 4; ++term) {
    const auto [a, b] = PowellTerm::kVariables[term];
    auto* cost = new ceres::AutoDiffCostFunction<PowellTerm, 1, 1, 1>(new PowellTerm{term});
    test->problem.AddResidualBlock(cost, nullptr, test->blocks[static_cast<std::size_t>(a)].data(),
                                   test->blocks[static_cast<std::size_t>(b)].data());
  }
  return test;
}

std::unique_ptr<TestProblem> MakeCurveFit(double loss_width) {
  auto test = std::make_unique<TestProblem>();
  double* m = test->Add({0.0});
  double* c = test->Add({0.0});
  std::mt19937 engine(3);
  ceres::LossFunction* loss = loss_width > 0.0 ? new ceres::CauchyLoss(loss_width) : nullptr;
  for (int k = 0; k < 40; ++k) {
    const double x = 0.1 * k;
    const double y =
        std::exp(0.3 * x + 0.1) + Uniform(&engine, -0.2, 0.2) + (k == 10 || k == 30 ? 4.0 : 0.0);
    auto* cost =
        new ceres::AutoDiffCostFunction<ExponentialTerm, 1, 1, 1>(new ExponentialTerm{x, y});
    test->problem.AddResidualBlock(cost, loss, m, c);
  }
  return test;
}

std::unique_ptr<TestProblem> MakeBundle(int num_cameras, int num_points,
                                        bool first_camera_constant) {
  auto test = std::make_unique<TestProblem>();
  std::mt19937 engine(5);
  std::vector<std::vector<double>> true_cameras;
  std::vector<double*> cameras;
  for (int c = 0; c < num_cameras; ++c) {
    std::vector<double> camera = {0.02 * c, -0.05 * c, 0.01,  0.3 * c, 0.1 * std::sin(c),
                                  0.05 * c, 500.0,     -0.02, 0.01};
    true_cameras.push_back(camera);
    for (int k = 0; k < 6 && c > 0; ++k) {
      camera[static_cast<std::size_t>(k)] += Uniform(&engine, -0.01, 0.01);
    }
    cameras.push_back(test->Add(camera));
  }
  for (int p = 0; p < num_points; ++p) {
    const std::vector<double> point = {Uniform(&engine, -2, 2), Uniform(&engine, -2, 2),
                                       Uniform(&engine, 5, 9)};
    double* start = test->Add({point[0] + Uniform(&engine, -0.05, 0.05), point[1],
                               point[2] + Uniform(&engine, -0.1, 0.1)});
    for (int c = 0; c < num_cameras; ++c) {
      if (num_cameras > 4 && (p + c) % 3 == 0) {
        continue;
      }
      double uv[2];
      Reprojection{0.0, 0.0}(true_cameras[static_cast<std::size_t>(c)].data(), point.data(), uv);
      auto* term = new Reprojection{uv[0] + Uniform(&engine, -0.5, 0.5),
                                    uv[1] + Uniform(&engine, -0.5, 0.5)};
      test->problem.AddResidualBlock(new ceres::AutoDiffCostFunction<Reprojection, 2, 9, 3>(term),
                                     nullptr, cameras[static_cast<std::size_t>(c)], start);
    }
  }
  if (first_camera_constant) {
    test->problem.SetParameterBlockConstant(cameras[0]);
  }
  return test;
}

std::unique_ptr<TestProblem> MakeWindow(int num_poses, int num_features, bool huber) {
  auto test = std::make_unique<TestProblem>();
  std::mt19937 engine(7);
  std::vector<double*> poses;
  std::vector<double*> velocities;
  for (int i = 0; i < num_poses; ++i) {
    std::vector<double> pose = PoseOf(i);
    for (std::size_t k = 0; k < 3 && i > 0; ++k) {
      pose[k] += Uniform(&engine, -0.02, 0.02);
    }
    poses.push_back(test->Add(pose));
    test->problem.AddParameterBlock(poses.back(), 7, MakePoseParameterization());
    velocities.push_back(test->Add(std::vector<double>(9, 0.1 * i)));
    test->problem.AddParameterBlock(velocities.back(), 9);
  }
  double* extrinsic = test->Add({0.05, 0.0, -0.02, 0.0, 0.0, std::sin(0.1), std::cos(0.1)});
  test->problem.AddParameterBlock(extrinsic, 7, MakePoseParameterization());
  test->problem.SetParameterBlockConstant(extrinsic);
  test->problem.SetParameterBlockConstant(poses[0]);
  AddFeatures(num_features, huber, poses, extrinsic, &engine, test.get());
  for (int i = 0; i + 1 < num_poses; ++i) {
    const auto k = static_cast<std::size_t>(i);
    auto* prior = DensePrior(
        15, {PoseOf(i), std::vector<double>(9, 0.1), PoseOf(i + 1), std::vector<double>(9, 0.15)});
    test->problem.AddResidualBlock(
        prior, nullptr,
        std::vector<double*>{poses[k], velocities[k], poses[k + 1], velocities[k + 1]});
  }
  test->problem.AddResidualBlock(DensePrior(5, {PoseOf(1)}), new ceres::CauchyLoss(0.5), extrinsic);
  test->problem.AddParameterBlock(test->Add({1.0, 2.0}), 2);
  return test;
}

std::unique_ptr<TestProblem> MediumBundle() {
  return MakeBundle(6, 80, /*first_camera_constant=*/true);
}

std::unique_ptr<TestProblem> MediumWindow() {
  return MakeWindow(6, 40, /*huber=*/true);
}

std::unique_ptr<TestProblem> MakeClosedCurve(unsigned seed, bool huber) {
  constexpr int kControlPoints = 30;
  const test::ClosedCurveScene scene(seed, kControlPoints, 120);
  auto made = std::make_unique<TestProblem>();
  std::vector<double*> blocks = {nullptr};
  std::vector<int> sizes = {1};
  for (const auto& point : scene.control_points) {
    blocks.push_back(made->Add({point[0], point[1]}));
    sizes.push_back(2);
  }
  for (const auto& observation : scene.observations) {
    blocks[0] = made->Add({observation.t});
    const auto evaluate = [seen = observation.point](const auto& x, double* r, double** J) {
      return test::EvaluateClosedCurve(kControlPoints, seen, x, r, J);
    };
    made->problem.AddResidualBlock(new lambdas::Cost(2, sizes, evaluate),
                                   huber ? new ceres::HuberLoss(0.4) : nullptr, blocks);
  }
  for (std::size_t k = 0; k < kControlPoints; ++k) {
    made->problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<test::Spring, 2, 2, 2>(new test::Spring), nullptr,
        blocks[k + 1], blocks[(k + 1) % kControlPoints + 1]);
  }
  return made;
}

}  // namespace inceres::testing
