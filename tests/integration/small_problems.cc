#include <cmath>
#include <iterator>

#include <ceres/autodiff_cost_function.h>
#include <gtest/gtest.h>

#include "inceres/io/g2o.h"
#include "integration/problems.h"
#include "support/classic_functors.h"
#include "support/random_values.h"
#include "tools/problems/ceres_loss.h"
#include "tools/problems/pose_graph_ceres_problem.h"

namespace inceres::test {
std::unique_ptr<Instance> MakePoseGraph(const std::string& path, const tools::LossSpec& loss) {
  PoseGraph graph;
  const Status read = ReadG2o(path, &graph);
  EXPECT_TRUE(read.ok()) << read.message;
  auto instance = std::make_unique<Instance>();
  instance->x = graph.poses;
  const Status built =
      tools::BuildPoseGraphCeresProblem(graph, loss, instance->x.data(), &instance->problem);
  EXPECT_TRUE(built.ok()) << built.message;
  return read.ok() && built.ok() ? std::move(instance) : nullptr;
}

std::unique_ptr<Instance> MakePowell(const tools::LossSpec& loss) {
  auto instance = std::make_unique<Instance>();
  instance->x.assign(std::begin(PowellTerm::kStart), std::end(PowellTerm::kStart));
  instance->problem = std::make_unique<ceres::Problem>();
  ceres::LossFunction* shared_loss = tools::MakeCeresLoss(loss).release();  // owned by the problem
  for (int term = 0; term < 4; ++term) {
    const auto [a, b] = PowellTerm::kVariables[term];
    instance->problem->AddResidualBlock(
        new ceres::AutoDiffCostFunction<PowellTerm, 1, 1, 1>(new PowellTerm{term}), shared_loss,
        instance->x.data() + a, instance->x.data() + b);
  }
  return instance;
}

std::unique_ptr<Instance> MakeCurveFit(const tools::LossSpec& loss) {
  auto instance = std::make_unique<Instance>();
  instance->x = {0.0, 0.0};
  instance->problem = std::make_unique<ceres::Problem>();
  ceres::LossFunction* shared_loss = tools::MakeCeresLoss(loss).release();  // owned by the problem
  Random random(3);
  for (int i = 0; i < 60; ++i) {
    const double x = i / 12.0;
    const double y = std::exp(0.3 * x + 0.1) + 0.2 * random.Unit() + (i % 10 == 7 ? 4.0 : 0.0);
    instance->problem->AddResidualBlock(
        new ceres::AutoDiffCostFunction<ExponentialTerm, 1, 1, 1>(new ExponentialTerm{x, y}),
        shared_loss, instance->x.data(), instance->x.data() + 1);
  }
  return instance;
}

}  // namespace inceres::test
