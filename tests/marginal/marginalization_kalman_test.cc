// A chain of linear-Gaussian factors with old states marginalized one at a time is the Kalman
// filter.
#include <Eigen/Dense>
#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/marginalization.h"
#include "marginal/linear_world.h"
#include "support/dense_oracle.h"
#include "support/random_values.h"

namespace inceres::test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kStates = 60;
constexpr int kSize = 4;    // position and velocity in the plane
constexpr int kSensed = 2;  // position

// Upper triangular U with UᵀU = C⁻¹.
MatrixXd Whitener(const MatrixXd& C) {
  return C.inverse().llt().matrixU();
}

struct Model {
  explicit Model(Random* random) {
    F = MatrixXd::Identity(kSize, kSize);
    F(0, 2) = F(1, 3) = 0.1;
    F(2, 3) = 0.05;
    F(3, 2) = -0.05;
    const MatrixXd G = RandomMatrix(random, kSize, kSize);
    Q = 0.01 * (G * G.transpose() + MatrixXd::Identity(kSize, kSize));
    H = MatrixXd::Zero(kSensed, kSize);
    H(0, 0) = H(1, 1) = 1.0;
    H(1, 2) = 0.3;
    const MatrixXd V = RandomMatrix(random, kSensed, kSensed);
    R = 0.1 * (V * V.transpose() + MatrixXd::Identity(kSensed, kSensed));
    P0 = 2.0 * MatrixXd::Identity(kSize, kSize);
    P0(0, 2) = P0(2, 0) = 0.7;
    m0 = RandomMatrix(random, kSize, 1);
    for (int k = 0; k < kStates; ++k) {
      measurements.push_back(3.0 * RandomMatrix(random, kSensed, 1));
    }
  }
  MatrixXd F, Q, H, R, P0;
  VectorXd m0;
  std::vector<VectorXd> measurements;
};

// Prediction and update as in any textbook, the covariance in Joseph's form.
struct KalmanFilter {
  explicit KalmanFilter(const Model& the_model)
      : model(the_model), mean(model.m0), covariance(model.P0) {}
  void Predict() {
    mean = model.F * mean;
    covariance = model.F * covariance * model.F.transpose() + model.Q;
  }
  void Update(const VectorXd& z) {
    const MatrixXd innovation = model.H * covariance * model.H.transpose() + model.R;
    const MatrixXd K = innovation.llt().solve(model.H * covariance).transpose();
    const MatrixXd left = MatrixXd::Identity(kSize, kSize) - K * model.H;
    mean += K * (z - model.H * mean);
    covariance = left * covariance * left.transpose() + K * model.R * K.transpose();
  }

  const Model& model;
  VectorXd mean;
  MatrixXd covariance;
};

// Factors of the chain.
LinearMeasurement Prior(const Model& model) {
  return {Whitener(model.P0), Whitener(model.P0) * model.m0};
}
LinearMeasurement Sensed(const Model& model, int k) {
  return {Whitener(model.R) * model.H,
          Whitener(model.R) * model.measurements[static_cast<std::size_t>(k)]};
}
LinearMeasurement Moved(const Model& model) {
  MatrixXd A(kSize, 2 * kSize);
  A << -model.F, MatrixXd::Identity(kSize, kSize);
  return {Whitener(model.Q) * A, VectorXd::Zero(kSize)};
}

TEST(MarginalizedChain, IsTheKalmanFilter) {
  Random random(3);
  const Model model(&random);
  KalmanFilter filter(model);
  LinearWorld world;
  // Wherever the states stand: a linear prior does not depend on it.
  const auto anywhere = [&] { return VectorXd(5.0 * RandomMatrix(&random, kSize, 1)); };
  const auto add = [&](const std::vector<VariableId>& ids, const LinearMeasurement& m) {
    world.AddFactor(ids, m.A, m.b);
  };
  VariableId state = world.AddVariable(anywhere());
  add({state}, Prior(model));
  for (int k = 0; k < kStates; ++k) {
    add({state}, Sensed(model, k));
    filter.Update(model.measurements[static_cast<std::size_t>(k)]);
    const DenseOracle oracle(world.graph, {state});
    const MatrixXd covariance = oracle.H.inverse();
    const VectorXd mean =
        Eigen::Map<const VectorXd>(world.graph.Values(state), kSize) - covariance * oracle.g;
    ASSERT_LT((covariance - filter.covariance).norm(), 1e-12 * filter.covariance.norm()) << k;
    ASSERT_LT((mean - filter.mean).norm(), 1e-12 * std::max(1.0, filter.mean.norm())) << k;

    const VariableId next = world.AddVariable(anywhere());
    add({state, next}, Moved(model));
    MarginalizationRequest request;
    request.marginalized = {state};
    const MarginalizationSummary summary =
        Marginalize(request, MarginalizationOptions(), &world.graph);
    ASSERT_TRUE(summary.status.ok()) << summary.status.message;
    ASSERT_EQ(summary.kept, std::vector<VariableId>{next});
    state = next;
    filter.Predict();
  }
  EXPECT_EQ(world.graph.num_live_variables(), 1);
  EXPECT_EQ(world.graph.num_factors(), 1);
  EXPECT_LE(world.graph.num_variables(), 2);  // ids and places are used again
  EXPECT_EQ(world.graph.num_families(), 4);
}

// The same on the living solver, which moves to each mean.
TEST(MarginalizedChain, IsTheKalmanFilterOnAnIncrementalGraph) {
  Random random(4);
  const Model model(&random);
  KalmanFilter filter(model);
  IncrementalOptions options;
  options.function_tolerance = 0.0;
  options.min_damping = 1e-14;
  options.initial_damping = 1e-14;
  options.batch_share = 2.0;
  options.max_num_iterations = 10;
  IncrementalSolver solver(options);
  LinearFamilies families;
  const auto add = [&](GraphEdit* edit, const std::vector<VariableId>& ids,
                       const LinearMeasurement& m) {
    const auto family =
        families.For(static_cast<int>(m.b.size()), std::vector<int>(ids.size(), kSize),
                     [&](const auto& added) { return solver.AddFamily(added); });
    if (edit->revision() != solver.graph().revision()) {
      edit->Restart();  // a family came
    }
    edit->AddFactor(family, m, ids);
  };
  // Families first: an edit does not outlive a change of the graph.
  families.For(kSize, {kSize}, [&](const auto& added) { return solver.AddFamily(added); });
  families.For(kSensed, {kSize}, [&](const auto& added) { return solver.AddFamily(added); });
  families.For(kSize, {kSize, kSize}, [&](const auto& added) { return solver.AddFamily(added); });
  GraphEdit edit(solver.graph());
  const VectorXd start = VectorXd::Zero(kSize);
  VariableId state = edit.AddVariable(start.data(), kSize, Role::kFrame);
  add(&edit, {state}, Prior(model));
  for (int k = 0; k < kStates; ++k) {
    add(&edit, {state}, Sensed(model, k));
    const Status applied = solver.Apply(edit);
    ASSERT_TRUE(applied.ok()) << applied.message;
    solver.Update();
    filter.Update(model.measurements[static_cast<std::size_t>(k)]);
    const VectorXd mean = Eigen::Map<const VectorXd>(solver.Values(state), kSize);
    ASSERT_LT((mean - filter.mean).norm(), 1e-12 * std::max(1.0, filter.mean.norm())) << k;

    edit.Restart();
    const VectorXd guess = RandomMatrix(&random, kSize, 1);
    const VariableId next = edit.AddVariable(guess.data(), kSize, Role::kFrame);
    add(&edit, {state, next}, Moved(model));
    ASSERT_TRUE(solver.Apply(edit).ok());
    solver.Update();
    filter.Predict();
    MarginalizationRequest request;
    request.marginalized = {state};
    const MarginalizationSummary summary = solver.Marginalize(request, MarginalizationOptions());
    ASSERT_TRUE(summary.status.ok()) << summary.status.message;
    EXPECT_GT(summary.num_cached_factors, 0);
    const MatrixXd covariance =
        InformationOf(*FindLinearPrior(solver.graph(), summary.prior)).inverse();
    ASSERT_LT((covariance - filter.covariance).norm(), 1e-12 * filter.covariance.norm()) << k;
    state = next;
    edit.Restart();
  }
}

}  // namespace
}  // namespace inceres::test
