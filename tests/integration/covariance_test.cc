// Covariances of a ceres::Problem as the adapter hands it to the core, next to those of
// ceres::Covariance.
#include "inceres/solver/covariance.h"

#include <algorithm>
#include <map>

#include <ceres/covariance.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include "adapters/ceres/plan/graph_builder.h"
#include "adapters/ceres/plan/landmark_selection.h"
#include "adapters/ceres/read/factor_shapes.h"
#include "adapters/ceres/read/introspection.h"
#include "integration/problems.h"

namespace inceres::test {
namespace {

// The graph of a problem, and which of its variables each parameter block is.
struct Translation {
  explicit Translation(const ceres::Problem& problem) {
    const internal::ProblemView view = internal::Introspect(problem);
    const internal::ShapeTable shapes = internal::FindShapes(view);
    const auto blocks = internal::BuildGraph(
        view, internal::PlanGraph(view, shapes, internal::ChooseLandmarks(view, shapes)), &graph);
    for (const internal::StateBlock& block : blocks) {
      for (VariableId id = 0; id < graph.num_variables(); ++id) {
        if (graph.StateOffset(id) == block.offset) {
          variable[block.user] = id;
        }
      }
    }
  }
  FactorGraph graph;
  std::map<const double*, VariableId> variable;
};

void ExpectStock(std::unique_ptr<Instance> instance,
                 const std::vector<std::pair<int, int>>& pairs) {
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 50;
  ceres::Solver::Summary summary;
  ceres::Solve(options, instance->problem.get(), &summary);
  ASSERT_TRUE(summary.IsSolutionUsable());

  std::vector<double*> blocks;
  instance->problem->GetParameterBlocks(&blocks);
  std::sort(blocks.begin(), blocks.end());
  ceres::Covariance::Options covariance_options;
  covariance_options.algorithm_type = ceres::SPARSE_QR;
  ceres::Covariance stock(covariance_options);
  std::vector<std::pair<const double*, const double*>> stock_pairs;
  const Translation translation(*instance->problem);
  Covariance::Pairs our_pairs;
  for (const auto& [a, b] : pairs) {
    const double* block_a = blocks[static_cast<std::size_t>(a)];
    const double* block_b = blocks[static_cast<std::size_t>(b)];
    stock_pairs.emplace_back(block_a, block_b);
    our_pairs.emplace_back(translation.variable.at(block_a), translation.variable.at(block_b));
  }
  ASSERT_TRUE(stock.Compute(stock_pairs, instance->problem.get()));
  Covariance ours;
  const Status status = ours.Compute(translation.graph, our_pairs);
  ASSERT_TRUE(status.ok()) << status.message;
  int num_landmarks = 0;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const auto [a, b] = our_pairs[k];
    const int rows = translation.graph.TangentSize(a);
    const int columns = translation.graph.TangentSize(b);
    num_landmarks +=
        translation.graph.role(a) == Role::kLandmark || translation.graph.role(b) == Role::kLandmark
            ? 1
            : 0;
    std::vector<double> expected(static_cast<std::size_t>(rows * columns));
    std::vector<double> actual(expected.size());
    ASSERT_TRUE(stock.GetCovarianceBlockInTangentSpace(stock_pairs[k].first, stock_pairs[k].second,
                                                       expected.data()));
    ASSERT_TRUE(ours.Get(a, b, actual.data()));
    double largest = 0.0;
    for (const double entry : expected) {
      largest = std::max(largest, std::abs(entry));
    }
    ASSERT_GT(largest, 0.0);
    for (std::size_t i = 0; i < expected.size(); ++i) {
      EXPECT_NEAR(actual[i], expected[i], 1e-7 * largest)
          << "pair " << pairs[k].first << ", " << pairs[k].second;
    }
  }
  EXPECT_GE(num_landmarks, 2);
}

// Poses first in memory, then the inverse depths; poses 0 and 1 are constant.
TEST(CovarianceOfACeresProblem, PosesOnAManifoldAndInverseDepths) {
  ExpectStock(MakeInverseDepth(PoseUpdate::kManifold, Huber(1.0)),
              {{2, 2}, {2, 3}, {11, 4}, {11, 11}, {20, 20}, {20, 2}, {5, 40}, {20, 21}, {20, 200}});
}

TEST(CovarianceOfACeresProblem, CamerasAndPoints) {
  ExpectStock(MakeBal(SmallStreet(3, 1.0), tools::BalCameraModel::kAngleAxis,
                      Gauge::kTwoCamerasConstant, Huber(1.0)),
              {{2, 2}, {3, 2}, {7, 7}, {30, 30}, {30, 3}, {4, 31}, {30, 31}});
}

TEST(CovarianceOfACeresProblem, FreeGaugeIsAStatusInBoth) {
  const std::unique_ptr<Instance> instance =
      MakeBal(SmallStreet(3, 1.0), tools::BalCameraModel::kAngleAxis, Gauge::kFree, Huber(1.0));
  const Translation translation(*instance->problem);
  const VariableId camera = translation.variable.at(instance->x.data());
  EXPECT_EQ(Covariance().Compute(translation.graph, {{camera, camera}}).code,
            StatusCode::kSingular);
  ceres::Covariance::Options options;
  options.algorithm_type = ceres::SPARSE_QR;
  EXPECT_FALSE(ceres::Covariance(options).Compute(
      std::vector<std::pair<const double*, const double*>>{
          {instance->x.data(), instance->x.data()}},
      instance->problem.get()));
}

}  // namespace
}  // namespace inceres::test
