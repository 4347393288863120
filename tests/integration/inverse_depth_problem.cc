#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <ceres/autodiff_cost_function.h>
#include <ceres/manifold.h>
#include <ceres/product_manifold.h>

#include "examples/sliding_window/vins/local_parameterization.h"
#include "integration/problems.h"
#include "support/random_values.h"
#include "tools/problems/ceres_loss.h"

namespace inceres::test {
namespace {

constexpr int kNumPoses = 12;
constexpr int kNumPoints = 300;
constexpr int kTrackLength = 5;  // poses that see a point, its host included
constexpr double kFocalLength = 400.0;

using Pose = Eigen::Matrix<double, 7, 1>;  // p (3), q (x y z w): world from camera
using PoseManifold =
    ceres::ProductManifold<ceres::EuclideanManifold<3>, ceres::EigenQuaternionManifold>;

// A point seen in the host along (bearing, 1) at depth 1/ρ, seen again by another pose. Pixels.
struct InverseDepthError {
  double bearing[2];
  double observed[2];

  template <typename T>
  bool operator()(const T* host, const T* other, const T* inverse_depth, T* residuals) const {
    using Vector3 = Eigen::Matrix<T, 3, 1>;
    using Quaternion = Eigen::Quaternion<T>;
    const Vector3 in_host = Vector3(T(bearing[0]), T(bearing[1]), T(1.0)) / inverse_depth[0];
    const Vector3 world =
        Eigen::Map<const Quaternion>(host + 3) * in_host + Eigen::Map<const Vector3>(host);
    const Vector3 seen = Eigen::Map<const Quaternion>(other + 3).conjugate() *
                         (world - Eigen::Map<const Vector3>(other));
    residuals[0] = kFocalLength * (seen[0] / seen[2] - observed[0]);
    residuals[1] = kFocalLength * (seen[1] / seen[2] - observed[1]);
    return true;
  }
};

using AmbientCost = ceres::AutoDiffCostFunction<InverseDepthError, 2, 7, 7, 1>;

// [p + δp, q ⊗ [δθ/2; 1] normalized] with [I; 0] for its Jacobian: honest only together with
// TangentCost.
class VinsPoseParameterization : public sliding_window::LocalParameterization {
 public:
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    Eigen::Map<Eigen::Vector3d>{x_plus_delta} =
        Eigen::Map<const Eigen::Vector3d>(x) + Eigen::Map<const Eigen::Vector3d>(delta);
    const Eigen::Quaterniond turn(1.0, 0.5 * delta[3], 0.5 * delta[4], 0.5 * delta[5]);
    Eigen::Map<Eigen::Quaterniond>{x_plus_delta + 3} =
        (Eigen::Map<const Eigen::Quaterniond>(x + 3) * turn).normalized();
    return true;
  }
  bool ComputeJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>>(jacobian).setIdentity();
    return true;
  }
  int GlobalSize() const override { return 7; }
  int LocalSize() const override { return 6; }
};

// The same error whose pose Jacobians are those of the tangent: six columns and one of zeros.
class TangentCost : public ceres::SizedCostFunction<2, 7, 7, 1> {
 public:
  explicit TangentCost(const InverseDepthError& error) : ambient_(new InverseDepthError(error)) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    if (!ambient_.Evaluate(parameters, residuals, jacobians)) {
      return false;
    }
    for (int k = 0; k < 2 && jacobians != nullptr; ++k) {
      if (jacobians[k] != nullptr) {
        ToTangent(parameters[k] + 3, jacobians[k]);
      }
    }
    return true;
  }

 private:
  // J_q ∂(q ⊗ [δθ/2; 1])/∂δθ in place of J_q.
  static void ToTangent(const double* q, double* jacobian) {
    Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>> J(jacobian);
    Eigen::Matrix<double, 4, 3> dq;
    dq << q[3], -q[2], q[1], q[2], q[3], -q[0], -q[1], q[0], q[3], -q[0], -q[1], -q[2];
    const Eigen::Matrix<double, 2, 3> J_theta = 0.5 * J.rightCols<4>() * dq;
    J.middleCols<3>(3) = J_theta;
    J.col(6).setZero();
  }

  AmbientCost ambient_;
};

// Sideways along an arc, looking inwards.
Pose TruePose(int i) {
  const double angle = 0.06 * (i - 0.5 * kNumPoses);
  const Eigen::Quaterniond q(Eigen::AngleAxisd(-angle, Eigen::Vector3d::UnitY()) *
                             Eigen::AngleAxisd(0.02 * std::sin(i), Eigen::Vector3d::UnitX()));
  Pose pose;
  pose << 8.0 * std::sin(angle), 0.1 * std::cos(2.0 * i), 8.0 - 8.0 * std::cos(angle), q.coeffs();
  return pose;
}

Eigen::Vector3d InCamera(const Pose& pose, const Eigen::Vector3d& world) {
  return Eigen::Quaterniond(pose.tail<4>()).conjugate() * (world - pose.head<3>());
}

Pose Disturbed(const Pose& pose, Random* random) {
  Pose result;
  double delta[6];
  for (int k = 0; k < 6; ++k) {
    delta[k] = (k < 3 ? 0.2 : 0.05) * random->Unit();
  }
  VinsPoseParameterization().Plus(pose.data(), delta, result.data());
  return result;
}

void AddPoint(PoseUpdate update, int point, ceres::LossFunction* loss, Random* random,
              Instance* instance) {
  const Eigen::Vector3d world(random->Between(-3.0, 3.0), random->Between(-2.0, 2.0),
                              random->Between(5.0, 10.0));
  const int host = point % (kNumPoses - kTrackLength + 1);
  const Eigen::Vector3d in_host = InCamera(TruePose(host), world);
  double* poses = instance->x.data();
  double* inverse_depth = poses + std::ptrdiff_t{7} * kNumPoses + point;
  *inverse_depth = random->Between(0.6, 1.6) / in_host.z();
  for (int other = host + 1; other < host + kTrackLength; ++other) {
    const Eigen::Vector3d seen = InCamera(TruePose(other), world);
    const double noise = 0.5 / kFocalLength;
    const InverseDepthError error{{in_host.x() / in_host.z(), in_host.y() / in_host.z()},
                                  {seen.x() / seen.z() + noise * random->Unit(),
                                   seen.y() / seen.z() + noise * random->Unit()}};
    ceres::CostFunction* cost =
        update == PoseUpdate::kManifold
            ? static_cast<ceres::CostFunction*>(new AmbientCost(new InverseDepthError(error)))
            : new TangentCost(error);
    instance->problem->AddResidualBlock(cost, loss, poses + std::ptrdiff_t{7} * host,
                                        poses + std::ptrdiff_t{7} * other, inverse_depth);
  }
  instance->landmarks.push_back(inverse_depth);
}

}  // namespace

std::unique_ptr<Instance> MakeInverseDepth(PoseUpdate update, const tools::LossSpec& loss) {
  Random random(11);
  auto instance = std::make_unique<Instance>();
  instance->x.resize(7 * kNumPoses + kNumPoints);
  instance->problem = std::make_unique<ceres::Problem>();
  for (int i = 0; i < kNumPoses; ++i) {
    double* pose = instance->x.data() + std::ptrdiff_t{7} * i;
    Eigen::Map<Pose>{pose} = i < 2 ? TruePose(i) : Disturbed(TruePose(i), &random);
    if (update == PoseUpdate::kManifold) {
      instance->problem->AddParameterBlock(pose, 7, new PoseManifold);
    } else {
      instance->problem->AddParameterBlock(pose, 7, new VinsPoseParameterization);
    }
    if (i < 2) {
      instance->problem->SetParameterBlockConstant(pose);
    }
  }
  ceres::LossFunction* shared_loss = tools::MakeCeresLoss(loss).release();  // owned by the problem
  for (int point = 0; point < kNumPoints; ++point) {
    AddPoint(update, point, shared_loss, &random, instance.get());
  }
  return instance;
}

}  // namespace inceres::test
