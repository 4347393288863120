// Small problems whose factors touch the same variables: J as one dense matrix.
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/graph_edit.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "linearize/evaluator.h"
#include "linearize/jacobian_places.h"
#include "linearize/row_products.h"
#include "support/dense_oracle.h"
#include "support/random_values.h"
#include "support/test_families.h"

namespace inceres::internal {
namespace {

// Variables a (size 2), q (a unit quaternion) and b (1), a constant c (3); seven factors of a, c, q
// and three of b, a, all robust.
class WholeRows : public testing::Test {
 protected:
  WholeRows() {
    AddVariable(2);
    const std::vector<double> q = {0.5, -0.5, 0.5, 0.5};
    graph_.AddVariable(q.data(), 4, Role::kFrame, std::make_shared<QuaternionManifold>());
    AddVariable(1);
    AddVariable(3);
    graph_.SetConstant(3, true);
    AddFactors(2, {{2, 2}, {3, 3}, {4, 3}}, {0, 3, 1}, 7);
    AddFactors(3, {{1, 1}, {2, 2}}, {2, 0}, 3);
  }

  VariableId AddVariable(int size) {
    return graph_.AddVariable(random_.Vector(size).data(), size, Role::kFrame);
  }

  void AddFactors(int rows, const std::vector<FactorFamily::Slot>& slots,
                  const std::vector<VariableId>& variables, int count) {
    const auto family = graph_.AddFamily(std::make_shared<test::SmoothFamily>(rows, slots));
    for (int i = 0; i < count; ++i) {
      graph_.AddFactor(family, family->MakeMeasurement(&random_), variables,
                       std::make_shared<CauchyLoss>(0.7));
    }
  }

  JacobianStorage Storage() const {
    return StorageFor(graph_, Layout(graph_, /*eliminate_landmarks=*/true));
  }

  test::Random random_{5};
  FactorGraph graph_;
};

TEST_F(WholeRows, HoldTheJacobians) {
  ASSERT_EQ(Storage(), JacobianStorage::kWholeRows);
  const Executor executor(1);
  const Layout layout(graph_, /*eliminate_landmarks=*/true);
  Evaluator evaluator(graph_, layout, executor, JacobianStorage::kWholeRows);
  const test::DenseOracle oracle(graph_, layout.variables);
  for (int time = 0; time < 2; ++time) {  // the second time nothing is zero to begin with
    double cost = 0.0;
    ASSERT_TRUE(evaluator.EvaluateJacobians(/*known_point=*/false, &cost).ok());
    EXPECT_NEAR(cost, oracle.cost, 1e-12 * oracle.cost);
    Eigen::Index row = 0;
    for (const Linearization& cache : evaluator.families()) {
      ASSERT_EQ(cache.num_blocks(), 1);
      ASSERT_EQ(cache.slots.size(), 1u);
      const int stride = cache.slots[0].row_stride;
      for (int r = 0; r < cache.rows_per_block(); ++r, ++row) {
        EXPECT_NEAR(cache.residuals.data()[r], oracle.f(row), 1e-12);
        for (int c = 0; c < stride; ++c) {
          EXPECT_NEAR(cache.slots[0].data[r * stride + c],
                      c < layout.size() ? oracle.J(row, c) : 0.0, 1e-12)
              << "row " << row << ", column " << c;
        }
      }
    }
    ASSERT_EQ(row, oracle.J.rows());
  }
}

TEST_F(WholeRows, AreMultiplied) {
  const Executor executor(1);
  const Layout layout(graph_, /*eliminate_landmarks=*/true);
  Evaluator evaluator(graph_, layout, executor, JacobianStorage::kWholeRows);
  const test::DenseOracle oracle(graph_, layout.variables);
  double cost = 0.0;
  ASSERT_TRUE(evaluator.EvaluateJacobians(/*known_point=*/false, &cost).ok());
  const std::vector<double> v = random_.Vector(static_cast<std::size_t>(layout.size()));
  const Eigen::VectorXd Jv = oracle.J * Eigen::Map<const Eigen::VectorXd>(v.data(), layout.size());
  const RowProducts products = MultiplyJacobian(evaluator, v.data());
  EXPECT_NEAR(products.squared_norm, Jv.squaredNorm(), 1e-12 * Jv.squaredNorm());
  EXPECT_NEAR(products.model_decrease, -Jv.dot(oracle.f + 0.5 * Jv), 1e-12 * Jv.squaredNorm());
}

TEST_F(WholeRows, AreNotForFactorsOfDifferentVariables) {
  const VariableId other = AddVariable(1);
  AddFactors(1, {{1, 1}}, {other}, 1);
  EXPECT_EQ(Storage(), JacobianStorage::kWholeRows);  // each family has variables of its own
  const auto family = graph_.AddFamily(
      std::make_shared<test::SmoothFamily>(1, std::vector<FactorFamily::Slot>{{1, 1}}));
  graph_.AddFactor(family, family->MakeMeasurement(&random_), {other});
  EXPECT_EQ(Storage(), JacobianStorage::kWholeRows);
  graph_.AddFactor(family, family->MakeMeasurement(&random_), {2});
  EXPECT_EQ(Storage(), JacobianStorage::kBySlot);
}

TEST_F(WholeRows, AreNotForManyVariables) {
  const VariableId id = AddVariable(11);  // beside 6 tangent coordinates
  AddFactors(1, {{11, 11}}, {id}, 1);
  EXPECT_EQ(Storage(), JacobianStorage::kBySlot);
}

TEST_F(WholeRows, AreNotForManyResiduals) {
  AddFactors(1000, {{1, 1}}, {2}, 1);  // beside 23
  EXPECT_EQ(Storage(), JacobianStorage::kWholeRows);
  AddFactors(2, {{1, 1}}, {2}, 1);
  EXPECT_EQ(Storage(), JacobianStorage::kBySlot);
}

TEST_F(WholeRows, AreNotForLandmarks) {
  graph_.SetRole(2, Role::kLandmark);
  EXPECT_EQ(Storage(), JacobianStorage::kBySlot);
  EXPECT_EQ(StorageFor(graph_, Layout(graph_, /*eliminate_landmarks=*/false)),
            JacobianStorage::kWholeRows);
}

TEST_F(WholeRows, AreNotForFreePlaces) {
  GraphEdit edit(graph_);
  edit.RemoveFactor({1, 2});
  ASSERT_TRUE(graph_.Apply(edit).ok());
  EXPECT_EQ(Storage(), JacobianStorage::kBySlot);
}

}  // namespace
}  // namespace inceres::internal
