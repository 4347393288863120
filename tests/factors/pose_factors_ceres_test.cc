// The same values and derivatives as cost functions written independently for Ceres: rotation
// matrices of Eigen, AutoDiff, and the chain rule through Ceres's own manifolds.
#include <Eigen/Geometry>
#include <ceres/autodiff_cost_function.h>
#include <ceres/rotation.h>
#include <gtest/gtest.h>

#include "factors/pose_states.h"

namespace inceres {
namespace {

template <typename T>
using Vector3 = Eigen::Matrix<T, 3, 1>;

// Camera coordinates of a world point, the long way round: invert the pose as a 4×4 matrix.
template <typename T>
Vector3<T> IntoCamera(const T* pose, const Vector3<T>& X) {
  const Eigen::Quaternion<T> q(pose[6], pose[3], pose[4], pose[5]);
  Eigen::Transform<T, 3, Eigen::Isometry> world_from_camera =
      Eigen::Transform<T, 3, Eigen::Isometry>::Identity();
  world_from_camera.linear() = q.toRotationMatrix();
  world_from_camera.translation() = Vector3<T>(pose[0], pose[1], pose[2]);
  return world_from_camera.inverse() * X;
}

struct ReprojectionError {
  template <typename T>
  bool operator()(const T* a, const T* b, const T* d, T* residuals) const {
    const Eigen::Quaternion<T> q(a[6], a[3], a[4], a[5]);
    const Vector3<T> ray(T(m.anchor_point[0]), T(m.anchor_point[1]), T(1.0));
    const Vector3<T> X = q.toRotationMatrix() * (ray / d[0]) + Vector3<T>(a[0], a[1], a[2]);
    const Vector3<T> P = IntoCamera(b, X);
    const T e[2] = {P[0] / P[2] - m.observed_point[0], P[1] / P[2] - m.observed_point[1]};
    residuals[0] = m.sqrt_information[0] * e[0] + m.sqrt_information[1] * e[1];
    residuals[1] = m.sqrt_information[2] * e[1];
    return true;
  }
  InverseDepthReprojectionFamily::Measurement m;
};

struct BetweenError {
  template <typename T>
  bool operator()(const T* a, const T* b, T* residuals) const {
    const auto camera_from_world = [](const T* pose) {
      return Eigen::Quaternion<T>(pose[6], pose[3], pose[4], pose[5])
          .toRotationMatrix()
          .transpose()
          .eval();
    };
    const Eigen::Matrix<T, 3, 3> R_a = camera_from_world(a);
    const Eigen::Matrix<T, 3, 3> R_b = camera_from_world(b);
    const Eigen::Matrix<double, 3, 3> R_ab =
        Eigen::Quaterniond(m.q_ab[3], m.q_ab[0], m.q_ab[1], m.q_ab[2]).toRotationMatrix();
    const Eigen::Matrix<T, 3, 3> E = R_a * R_b.transpose() * R_ab.transpose().cast<T>();
    Eigen::Matrix<T, 6, 1> e;
    ceres::RotationMatrixToAngleAxis(E.data(), e.data());
    e.template tail<3>() = R_b * Vector3<T>(a[0] - b[0], a[1] - b[1], a[2] - b[2]) -
                           Vector3<T>(T(m.p_ab[0]), T(m.p_ab[1]), T(m.p_ab[2]));
    const Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> U(m.sqrt_information);
    Eigen::Map<Eigen::Matrix<T, 6, 1>> r(residuals);
    r = U.cast<T>() * e;
    return true;
  }
  RelativePoseFamily::Measurement m;
};

// Ambient Jacobians of the cost function, projected with the manifolds' PlusJacobian, against the
// family's tangent ones.
void ExpectSame(const FactorFamily& family, const ceres::CostFunction& cost,
                const test::FactorState& state, double tolerance, int index) {
  const test::FactorValues ours = test::EvaluateFactor(family, state);
  ASSERT_FALSE(ours.failure.failed());
  const int rows = family.residual_size();
  std::vector<const double*> parameters;
  std::vector<std::vector<double>> ambient;
  std::vector<double*> blocks;
  for (const std::vector<double>& values : state.parameters) {
    parameters.push_back(values.data());
    ambient.emplace_back(static_cast<std::size_t>(rows) * values.size());
  }
  for (std::vector<double>& block : ambient) {
    blocks.push_back(block.data());
  }
  std::vector<double> residuals(static_cast<std::size_t>(rows));
  ASSERT_TRUE(cost.Evaluate(parameters.data(), residuals.data(), blocks.data()));
  const Eigen::Map<const Eigen::VectorXd> r(ours.residuals.data(), rows),
      expected_r(residuals.data(), rows);
  ASSERT_LT((r - expected_r).norm(), tolerance * (1.0 + expected_r.norm())) << "state " << index;

  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  for (std::size_t s = 0; s < parameters.size(); ++s) {
    const FactorFamily::Slot& slot = family.slot(static_cast<int>(s));
    RowMajor plus = RowMajor::Identity(slot.ambient_size, slot.tangent_size);
    if (state.manifolds[s] != nullptr) {
      ASSERT_TRUE(state.manifolds[s]->PlusJacobian(parameters[s], plus.data()));
    }
    const RowMajor expected =
        Eigen::Map<const RowMajor>(ambient[s].data(), rows, slot.ambient_size) * plus;
    const Eigen::Map<const RowMajor> actual(ours.jacobians[s].data(), rows, slot.tangent_size);
    ASSERT_LT((actual - expected).norm(), tolerance * (1.0 + expected.norm()))
        << "state " << index << ", slot " << s;
  }
}

TEST(PoseFactorsAgainstCeres, InverseDepthReprojection) {
  int index = 0;
  for (const test::ReprojectionState& s : test::ThousandReprojectionStates()) {
    if (s.state.parameters[2][0] != 0.0) {  // the textbook form divides by the inverse depth
      InverseDepthReprojectionFamily family;
      family.Add(s.measurement);
      ceres::AutoDiffCostFunction<ReprojectionError, 2, 7, 7, 1> cost(
          new ReprojectionError{s.measurement});
      ExpectSame(family, cost, s.state, 1e-9, index);
    }
    ++index;
  }
}

TEST(PoseFactorsAgainstCeres, RelativePose) {
  int index = 0;
  for (const test::RelativePoseState& s : test::ThousandRelativePoseStates()) {
    RelativePoseFamily family;
    family.Add(s.measurement);
    ceres::AutoDiffCostFunction<BetweenError, 6, 7, 7> cost(new BetweenError{s.measurement});
    ExpectSame(family, cost, s.state, 1e-9, index++);
  }
}

}  // namespace
}  // namespace inceres
