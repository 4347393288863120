// Our factors as cost functions of Ceres: projected through the block manifold they give the
// tangent Jacobians; AutoDiff agrees.
#include "tools/problems/factor_cost_function.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include "factors/bal_reference.h"
#include "factors/pose_states.h"
#include "factors/visual_states.h"
#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/point_reprojection.h"
#include "tools/problems/bal_cost.h"
#include "tools/problems/keyframe_cost.h"
#include "tools/problems/pose_graph_cost.h"
#include "tools/problems/stereo_cost.h"

namespace inceres::tools {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct Evaluated {
  std::vector<double> residuals;
  std::vector<RowMajor> jacobians;  // ambient
};

Evaluated EvaluateCost(const ceres::CostFunction& cost, const test::FactorState& state,
                       int held = -1) {
  Evaluated result;
  result.residuals.resize(static_cast<std::size_t>(cost.num_residuals()));
  std::vector<const double*> parameters;
  std::vector<double*> blocks;
  for (std::size_t s = 0; s < state.parameters.size(); ++s) {
    parameters.push_back(state.parameters[s].data());
    result.jacobians.push_back(RowMajor::Constant(
        cost.num_residuals(), cost.parameter_block_sizes()[s], test::kUnwritten));
  }
  for (std::size_t s = 0; s < state.parameters.size(); ++s) {
    blocks.push_back(static_cast<int>(s) == held ? nullptr : result.jacobians[s].data());
  }
  EXPECT_TRUE(cost.Evaluate(parameters.data(), result.residuals.data(), blocks.data()));
  return result;
}

// wrapped · [I; 0] = the tangent Jacobian = autodiff · PlusJacobian of the true manifold.
void ExpectSameTangent(const ceres::CostFunction& wrapped, const ceres::CostFunction& autodiff,
                       const test::FactorState& state) {
  const Evaluated ours = EvaluateCost(wrapped, state);
  const Evaluated theirs = EvaluateCost(autodiff, state);
  std::vector<const double*> parameters;
  for (const std::vector<double>& values : state.parameters) {
    parameters.push_back(values.data());
  }
  std::vector<double> cost_only(ours.residuals.size());
  ASSERT_TRUE(wrapped.Evaluate(parameters.data(), cost_only.data(), nullptr));
  ASSERT_EQ(cost_only, ours.residuals);
  for (std::size_t r = 0; r < ours.residuals.size(); ++r) {
    ASSERT_NEAR(ours.residuals[r], theirs.residuals[r],
                1e-9 * (1.0 + std::fabs(theirs.residuals[r])));
  }
  for (std::size_t s = 0; s < state.parameters.size(); ++s) {
    RowMajor actual = ours.jacobians[s];
    RowMajor expected = theirs.jacobians[s];
    if (state.manifolds[s] != nullptr) {
      RowMajor block_plus(7, 6), plus(7, 6);
      ASSERT_TRUE(PoseBlockManifold().PlusJacobian(state.parameters[s].data(), block_plus.data()));
      ASSERT_TRUE(state.manifolds[s]->PlusJacobian(state.parameters[s].data(), plus.data()));
      actual = actual * block_plus;
      expected = expected * plus;
    }
    ASSERT_LT((actual - expected).norm(), 1e-9 * (1.0 + expected.norm())) << "slot " << s;
    const Evaluated held = EvaluateCost(wrapped, state, static_cast<int>(s));
    ASSERT_EQ(held.jacobians[s],
              RowMajor::Constant(actual.rows(), held.jacobians[s].cols(), test::kUnwritten));
  }
}

TEST(FactorCostFunction, BalReprojection) {
  for (const BalState& s : ThousandBalStates()) {
    auto family = std::make_unique<BalReprojectionFamily>();
    family->Add({s.x, s.y});
    const std::unique_ptr<ceres::CostFunction> autodiff(
        BalReprojectionError::Create({0, 0, s.x, s.y}));
    ExpectSameTangent(FactorCostFunction(std::move(family)), *autodiff,
                      {{{s.camera, s.camera + 9}, {s.point, s.point + 3}}, {nullptr, nullptr}});
  }
}

TEST(FactorCostFunction, InverseDepthReprojection) {
  for (const test::ReprojectionState& s : test::ThousandReprojectionStates()) {
    auto family = std::make_unique<InverseDepthReprojectionFamily>();
    family->Add(s.measurement);
    const std::unique_ptr<ceres::CostFunction> autodiff(
        InverseDepthReprojectionError::Create(s.measurement));
    ExpectSameTangent(FactorCostFunction(std::move(family)), *autodiff, s.state);
  }
}

TEST(FactorCostFunction, RelativePose) {
  for (const test::RelativePoseState& s : test::ThousandRelativePoseStates()) {
    if (s.angle > 0.0 && s.angle < 1e-150) {
      continue;  // there the AutoDiff of Ceres's logarithm underflows
    }
    auto family = std::make_unique<RelativePoseFamily>();
    family->Add(s.measurement);
    const std::unique_ptr<ceres::CostFunction> autodiff(RelativePoseError::Create(s.measurement));
    ExpectSameTangent(FactorCostFunction(std::move(family)), *autodiff, s.state);
  }
}

TEST(FactorCostFunction, StereoReprojection) {
  test::Random random(6);
  const StereoCamera camera{500.0, 510.0, 320.0, 240.0, 0.3};
  for (int n = 0; n < 1000; ++n) {
    const test::SeenLandmark seen =
        test::RandomSeenLandmark(random, LandmarkKind::kPoint, &test::kPoseManifold, nullptr);
    StereoObservation measurement;
    measurement.left[0] = 300.0 * random.Unit();
    measurement.left[1] = 200.0 * random.Unit();
    measurement.right_u = 300.0 * random.Unit();
    for (const std::size_t k : {0u, 1u, 2u, 4u, 5u, 8u}) {
      measurement.sqrt_information[k] = random.Unit();
    }
    auto family = std::make_unique<StereoReprojectionFamily>(camera);
    family->Add(measurement);
    const std::unique_ptr<ceres::CostFunction> autodiff(
        StereoReprojectionError::Create(measurement, camera));
    ExpectSameTangent(FactorCostFunction(std::move(family)), *autodiff, seen.state);
  }
}

// Angles several turns apart and on either side of where the residual jumps.
TEST(FactorCostFunction, PlanarRelativePose) {
  test::Random random(7);
  for (int n = 0; n < 1000; ++n) {
    PlanarRelativePoseFamily::Measurement measurement;
    std::vector<double> a = random.Vector(3), b = random.Vector(3);
    a[2] *= 20.0;
    const std::vector<double> motion = random.Vector(3), U = random.Vector(6);
    std::copy(motion.begin(), motion.end(), measurement.motion);
    b[2] = a[2] + motion[2] + (n % 3 == 0 ? 3.1 : random.Between(-3.1, 3.1)) +
           2.0 * M_PI * (n % 5 - 2);
    std::size_t next = 0;
    for (const std::size_t k : {0u, 1u, 2u, 4u, 5u, 8u}) {
      measurement.sqrt_information[k] = U[next++];
    }
    auto family = std::make_unique<PlanarRelativePoseFamily>();
    family->Add(measurement);
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> sqrt_information(
        measurement.sqrt_information);
    const std::unique_ptr<ceres::CostFunction> autodiff(Se2BetweenError::Create(
        Eigen::Map<const Eigen::Vector3d>(motion.data()), sqrt_information));
    ExpectSameTangent(FactorCostFunction(std::move(family)), *autodiff,
                      {{a, b}, {nullptr, nullptr}});
  }
}

TEST(FactorCostFunction, DiagonalPriorOnPartOfACamera) {
  test::Random random(3);
  auto family = std::make_unique<DiagonalPriorFamily>(6, 9, 9);
  const DiagonalPriorFamily::Measurement prior{random.Vector(6), random.Vector(6)};
  family->Add(prior);
  const std::unique_ptr<ceres::CostFunction> autodiff(
      DiagonalPriorError<6, 9>::Create(prior.mean.data(), prior.sqrt_information.data()));
  ExpectSameTangent(FactorCostFunction(std::move(family)), *autodiff,
                    {{random.Vector(9)}, {nullptr}});
}

TEST(FactorCostFunction, AFactorThatFailsReturnsFalse) {
  auto family = std::make_unique<BalReprojectionFamily>();
  family->Add({1.0, 2.0});
  const FactorCostFunction cost(std::move(family));
  const double camera[9] = {0, 0, 0, 0, 0, 0, 500, 0, 0};
  const double point[3] = {1, 1, 0};
  const double* parameters[] = {camera, point};
  double residuals[2];
  EXPECT_FALSE(cost.Evaluate(parameters, residuals, nullptr));
}

TEST(PoseBlockManifold, MinusUndoesPlus) {
  test::Random random(4);
  const PoseBlockManifold manifold;
  for (int n = 0; n < 1000; ++n) {
    double x[7], y[7], back[6];
    const std::vector<double> delta = random.Vector(6);
    x[0] = random.Unit();
    x[1] = random.Unit();
    x[2] = random.Unit();
    test::RandomRotation(random, random.Between(0.0, 3.1), x + 3);
    ASSERT_TRUE(manifold.Plus(x, delta.data(), y));
    ASSERT_TRUE(manifold.Minus(y, x, back));
    for (int k = 0; k < 6; ++k) {
      ASSERT_NEAR(back[k], delta[static_cast<std::size_t>(k)], 1e-14);
    }
  }
  RowMajor plus(7, 6), minus(6, 7);
  const double x[7] = {0, 0, 0, 0, 0, 0, 1};
  ASSERT_TRUE(manifold.PlusJacobian(x, plus.data()));
  ASSERT_TRUE(manifold.MinusJacobian(x, minus.data()));
  EXPECT_EQ(minus * plus, RowMajor::Identity(6, 6));
}

}  // namespace
}  // namespace inceres::tools
