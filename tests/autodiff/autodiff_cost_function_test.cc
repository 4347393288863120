// inceres::AutoDiffCostFunction and ceres::AutoDiffCostFunction of the same functors.

#include "inceres/ceres/autodiff_cost_function.h"

#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <ceres/autodiff_cost_function.h>
#include <ceres/dynamic_autodiff_cost_function.h>
#include <gtest/gtest.h>

#include "autodiff/compare_jets.h"
#include "autodiff/gallery.h"
#include "inceres/ceres/dynamic_autodiff_cost_function.h"
#include "support/random_values.h"

namespace inceres {
namespace {

// Everything that a cost function writes.
struct Evaluation {
  explicit Evaluation(const ceres::CostFunction& cost)
      : residuals(static_cast<std::size_t>(cost.num_residuals()), -7.0) {
    for (const int size : cost.parameter_block_sizes()) {
      jacobians.emplace_back(residuals.size() * static_cast<std::size_t>(size), -7.0);
    }
  }
  // With the Jacobian of one block left out; −1: none.
  bool Run(const ceres::CostFunction& cost, const std::vector<std::vector<double>>& blocks,
           int constant) {
    std::vector<const double*> parameters;
    std::vector<double*> pointers;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      parameters.push_back(blocks[b].data());
      pointers.push_back(static_cast<int>(b) == constant ? nullptr : jacobians[b].data());
    }
    return cost.Evaluate(parameters.data(), residuals.data(), pointers.data());
  }

  std::vector<double> residuals;
  std::vector<std::vector<double>> jacobians;
};

void ExpectClose(const std::vector<double>& ours, const std::vector<double>& stock) {
  ASSERT_EQ(ours.size(), stock.size());
  for (std::size_t k = 0; k < ours.size(); ++k) {
    EXPECT_TRUE(test::AreClose(ours[k], stock[k]))
        << "entry " << k << ": " << ours[k] << " where Ceres has " << stock[k];
  }
}

void ExpectSameEvaluations(const ceres::CostFunction& ours, const ceres::CostFunction& stock,
                           const std::vector<std::vector<double>>& blocks) {
  for (int constant = -1; constant < static_cast<int>(blocks.size()); ++constant) {
    SCOPED_TRACE(::testing::Message() << "constant block " << constant);
    Evaluation our_evaluation(ours);
    Evaluation stock_evaluation(stock);
    ASSERT_TRUE(our_evaluation.Run(ours, blocks, constant));
    ASSERT_TRUE(stock_evaluation.Run(stock, blocks, constant));
    ExpectClose(our_evaluation.residuals, stock_evaluation.residuals);
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      SCOPED_TRACE(::testing::Message() << "block " << b);
      ExpectClose(our_evaluation.jacobians[b], stock_evaluation.jacobians[b]);
    }
  }
}

// At a thousand states; each tenth has a block of zeros, where formulas branch.
template <typename Functor, int kResiduals, int... Ns>
void CompareFunctor() {
  const AutoDiffCostFunction<Functor, kResiduals, Ns...> ours(new Functor);
  const ceres::AutoDiffCostFunction<Functor, kResiduals, Ns...> stock(new Functor);
  EXPECT_EQ(ours.num_residuals(), stock.num_residuals());
  EXPECT_EQ(ours.parameter_block_sizes(), stock.parameter_block_sizes());
  test::Random random(21);
  for (int state = 0; state < 1000 && !::testing::Test::HasFailure(); ++state) {
    SCOPED_TRACE(::testing::Message() << "state " << state);
    std::vector<std::vector<double>> blocks;
    for (const int size : {Ns...}) {
      blocks.push_back(random.Vector(static_cast<std::size_t>(size)));
    }
    if (state % 10 == 0) {
      std::fill(blocks[0].begin(),
                blocks[0].begin() + std::min(3, static_cast<int>(blocks[0].size())), 0.0);
    }
    ExpectSameEvaluations(ours, stock, blocks);
  }
}

TEST(AutoDiffCostFunction, SnavelyWithAndWithoutRotation) {
  CompareFunctor<test::SnavelyFunctor, 2, 9, 3>();
}
TEST(AutoDiffCostFunction, EigensTypes) {
  CompareFunctor<test::RelativePoseFunctor, 6, 3, 4, 3, 4>();
}
TEST(AutoDiffCostFunction, FunctionsByTheirFullNames) {
  CompareFunctor<test::QualifiedFunctor, 3, 3, 3>();
}
TEST(AutoDiffCostFunction, Loops) {
  CompareFunctor<test::PolynomialFunctor, 7, 5>();
}
TEST(AutoDiffCostFunction, MoreDerivativesThanAreUnrolled) {
  CompareFunctor<test::WideFunctor, 2, 40, 2>();
}
TEST(AutoDiffCostFunction, DerivativesSetByHand) {
  CompareFunctor<test::InterpolatingFunctor, 1, 2>();
}
TEST(AutoDiffCostFunction, TenBlocks) {
  CompareFunctor<test::ManyBlocksFunctor, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2>();
}

TEST(AutoDiffCostFunction, ResidualsWhoseNumberIsSaidAtRunTime) {
  auto* functor = new test::PolynomialFunctor;
  functor->num_points = 4;
  const AutoDiffCostFunction<test::PolynomialFunctor, ceres::DYNAMIC, 5> ours(functor, 4);
  const ceres::AutoDiffCostFunction<test::PolynomialFunctor, ceres::DYNAMIC, 5> stock(
      new test::PolynomialFunctor(*functor), 4);
  EXPECT_EQ(ours.num_residuals(), 4);
  ExpectSameEvaluations(ours, stock, {{0.1, -0.2, 0.3, 0.4, -0.5}});
}

// 200 values as Jets are more than a stack should hold.
struct HugeFunctor {
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    residual[0] = T(0.0);
    for (int k = 0; k < 200; ++k) {
      residual[0] += x[k] * x[k] * (k + 1.0);
    }
    return true;
  }
};

TEST(AutoDiffCostFunction, MoreParametersThanTheStackHolds) {
  CompareFunctor<HugeFunctor, 1, 200>();
}

// Blocks of any number and size: a sum of products of neighbors.
struct NeighborsFunctor {
  template <typename T>
  bool operator()(T const* const* blocks, T* residuals) const {
    residuals[0] = blocks[0][0] * blocks[1][2] + sin(blocks[2][4]);
    residuals[1] = blocks[2][0] / (2.0 + blocks[1][0] * blocks[1][1]);
    residuals[2] = T(4.0);
    return blocks[0][0] < 2.0;
  }
};

template <typename Cost>
void AddSizes(Cost* cost) {
  for (const int size : {1, 3, 5}) {
    cost->AddParameterBlock(size);
  }
  cost->SetNumResiduals(3);
}

TEST(DynamicAutoDiffCostFunction, BlocksWhoseSizesAreSaidAtRunTime) {
  DynamicAutoDiffCostFunction<NeighborsFunctor> ours(new NeighborsFunctor);
  DynamicAutoDiffCostFunction<NeighborsFunctor, 3> ours_by_threes(new NeighborsFunctor);
  ceres::DynamicAutoDiffCostFunction<NeighborsFunctor> stock(new NeighborsFunctor);
  AddSizes(&ours);
  AddSizes(&ours_by_threes);
  AddSizes(&stock);
  test::Random random(51);
  for (int state = 0; state < 100; ++state) {
    const std::vector<std::vector<double>> blocks = {random.Vector(1), random.Vector(3),
                                                     random.Vector(5)};
    ExpectSameEvaluations(ours, stock, blocks);
    ExpectSameEvaluations(ours_by_threes, stock, blocks);
  }
  Evaluation evaluation(ours);
  EXPECT_FALSE(evaluation.Run(ours, {{2.5}, {0.0, 0.0, 0.0}, std::vector<double>(5)}, -1));
}

TEST(DynamicAutoDiffCostFunction, ResidualsAreWrittenWhereAllBlocksAreConstant) {
  DynamicAutoDiffCostFunction<NeighborsFunctor> cost(new NeighborsFunctor);
  AddSizes(&cost);
  const DynamicAutoDiffCostFunction<NeighborsFunctor> moved(std::move(cost));
  const std::vector<double> values(5, 0.5);
  const double* parameters[] = {values.data(), values.data(), values.data()};
  double* jacobians[] = {nullptr, nullptr, nullptr};
  double residuals[3] = {};
  EXPECT_TRUE(moved.Evaluate(parameters, residuals, jacobians));
  EXPECT_EQ(residuals[0], 0.25 + std::sin(0.5));
  EXPECT_EQ(residuals[2], 4.0);
}

struct FailingFunctor {
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    residual[0] = x[0];
    return x[0] < 1.0;
  }
};

TEST(AutoDiffCostFunction, AFunctorThatReturnsFalseFailsAndWritesNothing) {
  const AutoDiffCostFunction<FailingFunctor, 1, 1> cost(new FailingFunctor);
  Evaluation evaluation(cost);
  EXPECT_TRUE(evaluation.Run(cost, {{0.5}}, -1));
  EXPECT_EQ(evaluation.jacobians[0][0], 1.0);
  Evaluation failed(cost);
  EXPECT_FALSE(failed.Run(cost, {{1.5}}, -1));
  EXPECT_EQ(failed.residuals[0], -7.0);
  EXPECT_EQ(failed.jacobians[0][0], -7.0);
  const double value = 1.5;
  const double* parameters[] = {&value};
  double residual = 0.0;
  EXPECT_FALSE(cost.Evaluate(parameters, &residual, nullptr));
}

struct ForgetfulFunctor {
  template <typename T>
  bool operator()(const T* x, T* residuals) const {
    residuals[0] = sqrt(x[0] - 1.0);
    return true;  // residuals[1] is forgotten
  }
};

TEST(AutoDiffCostFunction, WhatIsForgottenOrNotANumberIsSeen) {
  const AutoDiffCostFunction<ForgetfulFunctor, 2, 1> cost(new ForgetfulFunctor);
  Evaluation evaluation(cost);
  EXPECT_TRUE(evaluation.Run(cost, {{0.0}}, -1));
  EXPECT_TRUE(std::isnan(evaluation.residuals[0]));
  EXPECT_TRUE(std::isnan(evaluation.jacobians[0][0]));
  EXPECT_EQ(evaluation.residuals[1], 1e302);  // Ceres's kImpossibleValue
  EXPECT_EQ(evaluation.jacobians[0][1], 1e302);
}

struct CountedFunctor {
  explicit CountedFunctor(int* counter) : alive(counter) { ++*alive; }
  ~CountedFunctor() { --*alive; }
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    residual[0] = x[0];
    return true;
  }
  int* alive;
};

TEST(AutoDiffCostFunction, OwnsTheFunctorUnlessToldOtherwise) {
  using Cost = AutoDiffCostFunction<CountedFunctor, 1, 1>;
  int alive = 0;
  {
    Cost first(new CountedFunctor(&alive));
    const Cost second(std::move(first));
    EXPECT_EQ(second.functor().alive, &alive);
    EXPECT_EQ(alive, 1);
  }
  EXPECT_EQ(alive, 0);
  CountedFunctor kept(&alive);
  { const Cost borrowing(&kept, ceres::DO_NOT_TAKE_OWNERSHIP); }
  EXPECT_EQ(alive, 1);
}

}  // namespace
}  // namespace inceres
