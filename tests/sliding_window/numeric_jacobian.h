#pragma once

#include <functional>
#include <vector>

#include <Eigen/Core>
#include <ceres/cost_function.h>
#include <ceres/manifold.h>
#include <gtest/gtest.h>

#include "common/linearize.h"
#include "vins/pose_parameterization.h"

namespace sliding_window {

using Values = std::vector<std::vector<double>>;

/// How a parameter block moves: x + d, and the derivative of that.
struct Motion {
  int tangent_size;
  std::function<std::vector<double>(const std::vector<double>& x, const Eigen::VectorXd& d)> plus;
  std::function<RowMajorMatrix(const std::vector<double>& x)> jacobian;
};

inline Motion Straight(int size) {
  return {size,
          [](const std::vector<double>& x, const Eigen::VectorXd& d) {
            std::vector<double> moved(x);
            Eigen::Map<Eigen::VectorXd>(moved.data(), d.size()) += d;
            return moved;
          },
          [size](const std::vector<double>& /*x*/) {
            return RowMajorMatrix(RowMajorMatrix::Identity(size, size));
          }};
}

/// `Object` is a ceres::Manifold or a ceres::LocalParameterization.
inline Motion By(const ceres::Manifold& manifold) {
  return {manifold.TangentSize(),
          [&manifold](const std::vector<double>& x, const Eigen::VectorXd& d) {
            std::vector<double> moved(x.size());
            EXPECT_TRUE(manifold.Plus(x.data(), d.data(), moved.data()));
            return moved;
          },
          [&manifold](const std::vector<double>& x) {
            RowMajorMatrix J(manifold.AmbientSize(), manifold.TangentSize());
            EXPECT_TRUE(manifold.PlusJacobian(x.data(), J.data()));
            return J;
          }};
}

inline Motion ByVinsPose() {
  return {6,
          [](const std::vector<double>& x, const Eigen::VectorXd& d) {
            std::vector<double> moved(x.size());
            EXPECT_TRUE(PoseParameterization().Plus(x.data(), d.data(), moved.data()));
            return moved;
          },
          [](const std::vector<double>& x) {
            RowMajorMatrix J(7, 6);
            EXPECT_TRUE(PoseParameterization().ComputeJacobian(x.data(), J.data()));
            return J;
          }};
}

inline std::vector<const double*> Pointers(const Values& x) {
  std::vector<const double*> pointers;
  for (const std::vector<double>& block : x) {
    pointers.push_back(block.data());
  }
  return pointers;
}

inline Eigen::VectorXd ResidualAt(const ceres::CostFunction& cost, const Values& x) {
  Eigen::VectorXd r(cost.num_residuals());
  EXPECT_TRUE(cost.Evaluate(Pointers(x).data(), r.data(), nullptr));
  return r;
}

/// Compares the cost function's tangent Jacobians with central differences, and its residual with
/// Jacobians with that without.
inline void ExpectJacobiansAreDerivatives(const ceres::CostFunction& cost, const Values& x,
                                          const std::vector<Motion>& motions, double tolerance) {
  constexpr double kStep = 1e-5;
  const LinearizedFactor at_x = Linearize(cost, nullptr, Pointers(x));
  ASSERT_EQ(at_x.r, ResidualAt(cost, x));
  for (std::size_t i = 0; i < x.size(); ++i) {
    const RowMajorMatrix J = at_x.J[i] * motions[i].jacobian(x[i]);
    const double scale = std::max(1.0, J.cwiseAbs().maxCoeff());
    for (int k = 0; k < motions[i].tangent_size; ++k) {
      const Eigen::VectorXd d = kStep * Eigen::VectorXd::Unit(motions[i].tangent_size, k);
      Values ahead(x);
      Values behind(x);
      ahead[i] = motions[i].plus(x[i], d);
      behind[i] = motions[i].plus(x[i], -d);
      const Eigen::VectorXd difference =
          (ResidualAt(cost, ahead) - ResidualAt(cost, behind)) / (2.0 * kStep);
      EXPECT_LT((J.col(k) - difference).cwiseAbs().maxCoeff(), tolerance * scale)
          << "block " << i << ", column " << k;
    }
  }
}

}  // namespace sliding_window
