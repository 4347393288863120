// ITERATIVE_SCHUR and CGNR in exact mode next to stock Ceres: the same trace, each step after as
// many iterations of conjugate gradients.
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "adapters/compare_with_stock.h"
#include "adapters/test_problems.h"

namespace inceres {
namespace {

using testing::BothSolved;
using testing::MediumBundle;
using testing::MediumWindow;
using testing::TestProblem;

// How far costs may lie apart, relative, for the iterations behind them to be counted the same.
constexpr double kSameCost = 1e-9;

ceres::Solver::Options Iterative(ceres::LinearSolverType type,
                                 ceres::PreconditionerType preconditioner) {
  ceres::Solver::Options options;
  options.linear_solver_type = type;
  options.preconditioner_type = preconditioner;
  options.max_num_iterations = 12;
  return options;
}

// Blocks of these sizes in the first group, the others in one.
auto First(std::vector<std::size_t> sizes) {
  return [sizes](TestProblem* test, ceres::Solver::Options* options) {
    options->linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (std::vector<double>& block : test->blocks) {
      const bool is_first = std::find(sizes.begin(), sizes.end(), block.size()) != sizes.end();
      options->linear_solver_ordering->AddElementToGroup(block.data(), is_first ? 0 : 1);
    }
  };
}

// And the others in groups of their own, one after the other: in one group their order would be
// that of their addresses, by which clusters break ties.
auto FirstThenInOrder(std::vector<std::size_t> sizes) {
  return [sizes](TestProblem* test, ceres::Solver::Options* options) {
    First(sizes)(test, options);
    int group = 0;
    for (std::vector<double>& block : test->blocks) {
      if (options->linear_solver_ordering->GroupId(block.data()) != 0) {
        options->linear_solver_ordering->AddElementToGroup(block.data(), ++group);
      }
    }
  };
}

// As long as the costs are stock's. Rounding grows from step to step; where it has grown to 1e-9 a
// test of conjugate gradients may come out the other way.
void ExpectStocksIterations(const BothSolved& both, std::size_t at_least) {
  ASSERT_FALSE(both.report.used_stock) << both.report.fallback_reason;
  const auto& ours = both.ours.iterations;
  const auto& stock = both.stock.iterations;
  std::size_t k = 0;
  for (; k < std::min(ours.size(), stock.size()); ++k) {
    if (std::abs(ours[k].cost - stock[k].cost) > kSameCost * stock[k].cost) {
      break;
    }
    EXPECT_EQ(ours[k].linear_solver_iterations, stock[k].linear_solver_iterations) << k;
    EXPECT_EQ(ours[k].step_is_successful, stock[k].step_is_successful) << k;
  }
  EXPECT_GE(k, at_least);
  EXPECT_NEAR(both.ours.final_cost, both.stock.final_cost, 1e-3 * both.stock.final_cost);
  EXPECT_EQ(both.ours.linear_solver_type_used, both.stock.linear_solver_type_used);
  EXPECT_EQ(both.ours.preconditioner_type_used, both.stock.preconditioner_type_used);
  EXPECT_EQ(both.ours.linear_solver_ordering_used, both.stock.linear_solver_ordering_used);
}

// In the last one of CLUSTER_…: SINGLE_LINKAGE; of others: explicit.
using IterativeWay = std::tuple<ceres::LinearSolverType, ceres::PreconditionerType, bool>;

bool IsByClusters(const IterativeWay& way) {
  return std::get<1>(way) == ceres::CLUSTER_JACOBI ||
         std::get<1>(way) == ceres::CLUSTER_TRIDIAGONAL;
}
class ConjugateGradientsTrace : public ::testing::TestWithParam<IterativeWay> {
 protected:
  // Without a preconditioner conjugate gradients lose their digits in the first steps.
  static std::size_t AtLeast(std::size_t count) {
    return std::get<1>(GetParam()) == ceres::IDENTITY ? 1 : count;
  }
  ceres::Solver::Options Options() const {
    ceres::Solver::Options options = Iterative(std::get<0>(GetParam()), std::get<1>(GetParam()));
    options.use_explicit_schur_complement = std::get<2>(GetParam()) && !IsByClusters(GetParam());
    if (std::get<2>(GetParam()) && IsByClusters(GetParam())) {
      options.visibility_clustering_type = ceres::SINGLE_LINKAGE;
    }
    return options;
  }
  static std::function<void(TestProblem*, ceres::Solver::Options*)> Order(
      const std::vector<std::size_t>& first) {
    if (IsByClusters(GetParam())) {
      return FirstThenInOrder(first);
    }
    return First(first);
  }
};

TEST_P(ConjugateGradientsTrace, IsStocksOnABundle) {
  ExpectStocksIterations(testing::SolveBoth(MediumBundle, Options()), AtLeast(4));
}

TEST_P(ConjugateGradientsTrace, IsStocksInAWindowWithManifoldsLossesAndConstants) {
  ExpectStocksIterations(testing::SolveBoth(MediumWindow, Options(), Order({1})), AtLeast(3));
}

// Cameras first: blocks of nine are eliminated, and the points are what is left.
TEST_P(ConjugateGradientsTrace, IsStocksWithCamerasEliminated) {
  for (const int max_iterations : {500, 6}) {
    ceres::Solver::Options options = Options();
    options.max_linear_solver_iterations = max_iterations;
    ExpectStocksIterations(testing::SolveBoth(MediumBundle, options, Order({9})), AtLeast(3));
  }
}

TEST_P(ConjugateGradientsTrace, IsStocksWithOtherLimits) {
  ceres::Solver::Options options = Options();
  options.eta = 1e-3;
  options.max_linear_solver_iterations = 7;
  ExpectStocksIterations(testing::SolveBoth(MediumBundle, options), AtLeast(3));
  options.eta = 0.9;
  options.min_linear_solver_iterations = 25;  // the residual is computed anew twice
  options.max_linear_solver_iterations = 500;
  ExpectStocksIterations(testing::SolveBoth(MediumBundle, options), AtLeast(3));
}

TEST_P(ConjugateGradientsTrace, HasTheSameBitsForTwoThreads) {
  ceres::Solver::Options options = Options();
  const BothSolved one = testing::SolveBoth(MediumBundle, options);
  options.num_threads = 2;
  const BothSolved two = testing::SolveBoth(MediumBundle, options);
  ASSERT_EQ(one.ours.iterations.size(), two.ours.iterations.size());
  for (std::size_t k = 0; k < one.ours.iterations.size(); ++k) {
    EXPECT_EQ(one.ours.iterations[k].cost, two.ours.iterations[k].cost) << k;
  }
}

std::string NameOf(const ::testing::TestParamInfo<IterativeWay>& info) {
  return std::string(ceres::LinearSolverTypeToString(std::get<0>(info.param))) + "_" +
         ceres::PreconditionerTypeToString(std::get<1>(info.param)) +
         (!std::get<2>(info.param)   ? ""
          : IsByClusters(info.param) ? "_single_linkage"
                                     : "_explicit");
}

// CGNR with some of the residual blocks as preconditioner: all but every fifth.
TEST(ConjugateGradients, ByASubsetAreStocks) {
  const auto four_fifths = [](TestProblem* test, ceres::Solver::Options* options) {
    std::vector<ceres::ResidualBlockId> ids;
    test->problem.GetResidualBlocks(&ids);
    for (std::size_t k = 0; k < ids.size(); ++k) {
      if (k % 5 != 0) {
        options->residual_blocks_for_subset_preconditioner.insert(ids[k]);
      }
    }
  };
  for (const auto& make : {MediumBundle, MediumWindow}) {
    const BothSolved both =
        testing::SolveBoth(make, Iterative(ceres::CGNR, ceres::SUBSET), four_fifths);
    ExpectStocksIterations(both, 3);
    ASSERT_GT(both.ours.iterations.size(), 1U);
    EXPECT_GT(both.ours.iterations[1].linear_solver_iterations, 1);
  }
}

// A block that no residual block of the subset touches has its damping alone in the preconditioner.
// With little of that, where a radius is large, the preconditioned system has a condition of the
// radius: stock then does not follow its own trace either, once its residual blocks come in another
// order (benchmarks/iterative_traces). So the radius is small here.
TEST(ConjugateGradients, ByASubsetThatLeavesABlockOutAreStocks) {
  const auto without_first_frame = [](TestProblem* test, ceres::Solver::Options* options) {
    std::vector<ceres::ResidualBlockId> ids;
    test->problem.GetResidualBlocks(&ids);
    double* left_out = nullptr;
    int num_left_out = 0;
    for (const ceres::ResidualBlockId id : ids) {
      std::vector<double*> blocks;
      test->problem.GetParameterBlocksForResidualBlock(id, &blocks);
      // The first one that moves and is not the first of all, which may be held.
      if (left_out == nullptr && !test->problem.IsParameterBlockConstant(blocks[0])) {
        left_out = blocks[0];
      }
      if (std::find(blocks.begin(), blocks.end(), left_out) == blocks.end()) {
        options->residual_blocks_for_subset_preconditioner.insert(id);
      } else {
        ++num_left_out;
      }
    }
    EXPECT_GT(num_left_out, 1);
  };
  for (const auto& make : {MediumBundle, MediumWindow}) {
    ceres::Solver::Options options = Iterative(ceres::CGNR, ceres::SUBSET);
    options.initial_trust_region_radius = 1.0;
    options.max_trust_region_radius = 10.0;
    const BothSolved both = testing::SolveBoth(make, options, without_first_frame);
    ExpectStocksIterations(both, 4);
    ASSERT_GT(both.ours.iterations.size(), 1U);
    EXPECT_GT(both.ours.iterations[1].linear_solver_iterations, 1);
  }
}

// The independent set of most blocks has poses in it, which share no residual block.
TEST(ConjugateGradients, LargeBlocksAreEliminatedWhereNobodySaysWhich) {
  for (const auto preconditioner :
       {ceres::JACOBI, ceres::CLUSTER_JACOBI, ceres::CLUSTER_TRIDIAGONAL}) {
    const BothSolved both =
        testing::SolveBoth(MediumWindow, Iterative(ceres::ITERATIVE_SCHUR, preconditioner));
    ASSERT_FALSE(both.report.used_stock) << both.report.fallback_reason;
    EXPECT_NE(std::string(both.report.core.reduced_solver).find("large blocks"), std::string::npos)
        << both.report.core.reduced_solver;
    EXPECT_NEAR(both.ours.final_cost, both.stock.final_cost, 1e-3 * both.stock.final_cost);
    EXPECT_EQ(both.ours.linear_solver_ordering_used, both.stock.linear_solver_ordering_used);
  }
}

// A first group of constants only leaves nothing to eliminate: Ceres takes CGNR with JACOBI.
TEST(ConjugateGradients, WithoutAFirstGroupItIsTheNormalEquations) {
  const auto make = [] {
    auto test = MediumWindow();
    for (std::vector<double>& block : test->blocks) {
      if (block.size() == 1) {
        test->problem.SetParameterBlockConstant(block.data());
      }
    }
    return test;
  };
  const BothSolved both =
      testing::SolveBoth(make, Iterative(ceres::ITERATIVE_SCHUR, ceres::SCHUR_JACOBI), First({1}));
  ExpectStocksIterations(both, 3);
  EXPECT_EQ(both.ours.linear_solver_type_used, ceres::CGNR);
  EXPECT_EQ(both.ours.preconditioner_type_used, ceres::JACOBI);
}

INSTANTIATE_TEST_SUITE_P(
    Exact, ConjugateGradientsTrace,
    ::testing::Values(IterativeWay{ceres::ITERATIVE_SCHUR, ceres::IDENTITY, false},
                      IterativeWay{ceres::ITERATIVE_SCHUR, ceres::JACOBI, false},
                      IterativeWay{ceres::ITERATIVE_SCHUR, ceres::SCHUR_JACOBI, false},
                      IterativeWay{ceres::ITERATIVE_SCHUR, ceres::SCHUR_JACOBI, true},
                      IterativeWay{ceres::ITERATIVE_SCHUR, ceres::CLUSTER_JACOBI, false},
                      IterativeWay{ceres::ITERATIVE_SCHUR, ceres::CLUSTER_JACOBI, true},
                      IterativeWay{ceres::ITERATIVE_SCHUR, ceres::CLUSTER_TRIDIAGONAL, false},
                      IterativeWay{ceres::ITERATIVE_SCHUR, ceres::CLUSTER_TRIDIAGONAL, true},
                      IterativeWay{ceres::CGNR, ceres::IDENTITY, false},
                      IterativeWay{ceres::CGNR, ceres::JACOBI, false}),
    NameOf);

}  // namespace
}  // namespace inceres
