// Which structures a Solver has met, and what it may not remember of them: the same bits as a solve
// from nothing. That all ways have them is in solver_laws_test.cc.
#include <cstdint>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/linear/reduced_solver.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"
#include "support/random_graph.h"
#include "trust_region/same_bits.h"
#include "trust_region/solver_way.h"

namespace inceres {
namespace {

using test::BundleOptions;
using test::ExpectSameBits;
using test::MakeBundle;

BundleOptions Options() {
  return test::MixedBundle(80);
}

SolverOptions TenIterations() {
  SolverOptions options;
  options.max_num_iterations = 10;
  return options;
}

// Solves the same problem with the solver and from nothing; the solver's summary.
Summary SolveBothWays(const SolverOptions& options, const BundleOptions& bundle_options,
                      Solver* solver) {
  const auto ours = MakeBundle(bundle_options);
  const auto fresh = MakeBundle(bundle_options);
  Summary summary = solver->Solve(options, &ours->graph());
  const Summary expected = Solve(options, &fresh->graph());
  EXPECT_TRUE(expected.IsSolutionUsable()) << expected.message;
  EXPECT_FALSE(expected.structure_reused);
  ExpectSameBits(summary, expected);
  EXPECT_EQ(ours->graph().state(), fresh->graph().state());
  return summary;
}

TEST(RepeatedSolve, AnotherStructureIsSetUpAnew) {
  Solver solver;
  SolveBothWays(TenIterations(), Options(), &solver);
  std::vector<BundleOptions> others(5, Options());
  others[0].num_landmarks = 81;
  others[1].frame_sizes = {9};
  others[2].constants = false;
  others[3].manifolds = false;
  others[4].num_views = 4;
  for (std::size_t k = 0; k < others.size(); ++k) {
    SCOPED_TRACE(k);
    const BundleOptions& other = others[k];
    EXPECT_FALSE(SolveBothWays(TenIterations(), other, &solver).structure_reused);
    EXPECT_TRUE(SolveBothWays(TenIterations(), other, &solver).structure_reused);
    EXPECT_FALSE(SolveBothWays(TenIterations(), Options(), &solver).structure_reused);
  }
}

TEST(RepeatedSolve, OptionsThatSetUpDependsOnCount) {
  Solver solver;
  SolverOptions options = TenIterations();
  SolveBothWays(options, Options(), &solver);
  options.num_threads = 2;
  EXPECT_FALSE(SolveBothWays(options, Options(), &solver).structure_reused);
  options.linear_model = LinearModelKind::kPlain;
  EXPECT_FALSE(SolveBothWays(options, Options(), &solver).structure_reused);
  options.reduced_solver = ReducedSolverKind::kSparse;
  EXPECT_FALSE(SolveBothWays(options, Options(), &solver).structure_reused);
  options.strategy = TrustRegionStrategyKind::kDogleg;  // the strategy is the minimizer's business
  options.jacobi_scaling = false;
  EXPECT_TRUE(SolveBothWays(options, Options(), &solver).structure_reused);
  options.dynamic_sparsity = true;
  EXPECT_FALSE(SolveBothWays(options, Options(), &solver).structure_reused);
}

TEST(RepeatedSolve, SetConstantIsAnotherStructure) {
  Solver solver;
  const auto bundle = MakeBundle(Options());
  solver.Solve(TenIterations(), &bundle->graph());
  EXPECT_TRUE(solver.IsReadyFor(TenIterations(), bundle->graph()));
  bundle->graph().SetConstant(3, !bundle->graph().IsConstant(3));
  EXPECT_FALSE(solver.IsReadyFor(TenIterations(), bundle->graph()));
}

// One factor, x; what else its family wants to be called for, it does nothing with.
class Called final : public AmbientFamily<Called> {
 public:
  Called(bool prepares, bool recenters)
      : AmbientFamily(1, {{1, 1}}), prepares_(prepares), recenters_(recenters) {}
  int size() const override { return 1; }
  const char* Name() const override { return "called"; }
  bool Prepares() const override { return prepares_; }
  bool Recenters() const override { return recenters_; }
  bool EvaluateOne(int /*i*/, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    residuals[0] = parameters[0][0];
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = 1.0;
    }
    return true;
  }

 private:
  bool prepares_;
  bool recenters_;
};

// Such a family has tables, and Jacobians in double, where others are spared them.
TEST(RepeatedSolve, WhatFamiliesAreCalledForIsStructure) {
  const auto make = [](int kind) {
    FactorGraph graph;
    const double start = 1.0;
    const VariableId x = graph.AddVariable(&start, 1, Role::kFrame);
    graph.Connect(graph.AddFamily(std::make_shared<Called>((kind & 1) != 0, (kind & 2) != 0)), &x);
    return graph;
  };
  for (int kind = 0; kind < 4; ++kind) {
    Solver solver;
    FactorGraph graph = make(kind);
    ASSERT_TRUE(solver.Solve(SolverOptions(), &graph).IsSolutionUsable());
    for (int other = 0; other < 4; ++other) {
      EXPECT_EQ(solver.IsReadyFor(SolverOptions(), make(other)), other == kind) << other << kind;
    }
  }
}

// One variable of size 2, pulled to where `target` says; the borrowed constant b is added to the
// residual.
struct Pull {
  Pull(const double* b, std::shared_ptr<const Loss> loss, double target) {
    const double start[2] = {0.0, 0.0};
    auto family = std::make_shared<test::FunctionFamily>(
        2, std::vector<FactorFamily::Slot>{{2, 2}, {2, 2}},
        [target](int, const double* const* x, double* f, double** J) {
          for (int k = 0; k < 2; ++k) {
            f[k] = x[0][k] + x[1][k] - target;
          }
          if (J != nullptr && J[0] != nullptr) {
            J[0][0] = J[0][3] = 1.0;
            J[0][1] = J[0][2] = 0.0;
          }
          if (target > 100.0) {
            throw std::runtime_error("far too far");
          }
          return true;
        });
    const VariableId ids[2] = {graph.AddVariable(start, 2, Role::kFrame),
                               graph.AddBorrowedConstant(b, 2)};
    family->Add(0);
    graph.Connect(graph.AddFamily(family), ids, std::move(loss));
  }
  FactorGraph graph;
};

TEST(RepeatedSolve, BorrowedConstantsBoundsAndLossesAreTheNewGraphs) {
  const double first[2] = {1.0, 2.0};
  const double second[2] = {3.0, 5.0};
  Solver solver;
  {
    Pull pull(first, nullptr, 10.0);
    solver.Solve(SolverOptions(), &pull.graph);
    EXPECT_NEAR(pull.graph.Values(0)[0], 9.0, 1e-6);
  }
  Pull pull(second, std::make_shared<HuberLoss>(0.1), 10.0);
  const double lower[2] = {-1.0, -1.0};
  const double upper[2] = {20.0, 4.0};
  pull.graph.SetBounds(0, lower, upper);
  const Summary summary = solver.Solve(SolverOptions(), &pull.graph);
  EXPECT_TRUE(summary.structure_reused);
  EXPECT_TRUE(summary.is_constrained);
  EXPECT_NEAR(pull.graph.Values(0)[1], 4.0, 1e-9);  // without its bound it would go to 5
  EXPECT_LT(summary.initial_cost, 2.0);             // Huber's; the plain cost is 37
}

TEST(RepeatedSolve, PinsAreTheNewGraphs) {
  Solver solver;
  SolveBothWays(TenIterations(), Options(), &solver);
  const auto ours = MakeBundle(Options());
  const auto fresh = MakeBundle(Options());
  for (FactorGraph* graph : {&ours->graph(), &fresh->graph()}) {
    const std::vector<double> pinned(graph->Values(0), graph->Values(0) + graph->AmbientSize(0));
    graph->PinLinearization(0, pinned.data());
  }
  const Summary summary = solver.Solve(TenIterations(), &ours->graph());
  EXPECT_TRUE(summary.structure_reused);
  ExpectSameBits(summary, Solve(TenIterations(), &fresh->graph()));
  SolveBothWays(TenIterations(), Options(), &solver);  // and without one again
}

TEST(RepeatedSolve, GoesOnAfterAFailureAndAfterAnException) {
  const double b[2] = {1.0, 2.0};
  Solver solver;
  Pull good(b, nullptr, 10.0);
  solver.Solve(SolverOptions(), &good.graph);
  Pull broken(b, nullptr, std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(solver.Solve(SolverOptions(), &broken.graph).termination, Termination::kFailure);
  EXPECT_EQ(broken.graph.Values(0)[0], 0.0);
  Pull thrower(b, nullptr, 1000.0);
  EXPECT_THROW(solver.Solve(SolverOptions(), &thrower.graph), std::runtime_error);
  Pull again(b, nullptr, 4.0);
  EXPECT_TRUE(solver.Solve(SolverOptions(), &again.graph).IsSolutionUsable());
  EXPECT_NEAR(again.graph.Values(0)[0], 3.0, 1e-6);
}

TEST(RepeatedSolve, AUsersOwnReducedSolverIsMadeForEachSolve) {
  Solver solver;
  SolverOptions options = TenIterations();
  int num_made = 0;
  options.reduced_solver_factory = [&num_made]() -> std::unique_ptr<ReducedSolver> {
    ++num_made;
    return nullptr;
  };
  for (int k = 0; k < 2; ++k) {
    const auto bundle = MakeBundle(Options());
    EXPECT_EQ(solver.Solve(options, &bundle->graph()).termination, Termination::kFailure);
  }
  EXPECT_EQ(num_made, 2);
  EXPECT_EQ(solver.Bytes(), 0);
}

TEST(RepeatedSolve, HoldsNoMoreThanItMay) {
  Solver unlimited;
  const auto first = MakeBundle(Options());
  unlimited.Solve(TenIterations(), &first->graph());
  const std::int64_t bytes = unlimited.Bytes();
  ASSERT_GT(bytes, 0);
  for (const std::int64_t limit : {bytes, bytes - 1, std::int64_t{0}}) {
    Solver limited(limit);
    const auto bundle = MakeBundle(Options());
    EXPECT_TRUE(limited.Solve(TenIterations(), &bundle->graph()).IsSolutionUsable());
    EXPECT_EQ(limited.Bytes(), limit == bytes ? bytes : 0);
    EXPECT_EQ(limited.IsReadyFor(TenIterations(), bundle->graph()), limit == bytes);
  }
}

// Jacobians of more than 128 MiB lie without padding, S in the memory of its factor, and what
// factors need is looked up by variable. Who needs more of them sets up anew.
TEST(RepeatedSolve, OfLargeProblem) {
  constexpr int kNumFactors = 530000;
  BundleOptions large;
  large.num_frames = 40;
  large.num_landmarks = kNumFactors / 4;
  large.num_views = 4;
  large.frame_sizes = {9};
  large.losses = true;
  large.perturbation = 0.1;
  SolverOptions options;
  options.max_num_iterations = 1;
  options.reduced_solver = ReducedSolverKind::kSparse;
  Solver solver;
  const Summary first = SolveBothWays(options, large, &solver);
  EXPECT_FALSE(first.structure_reused);
  BundleOptions other = large;
  other.perturbation = 0.2;
  EXPECT_TRUE(SolveBothWays(options, other, &solver).structure_reused);
  options.refine_landmarks = true;
  const Summary refined = SolveBothWays(options, large, &solver);
  EXPECT_FALSE(refined.structure_reused);
  EXPECT_GT(refined.work.bytes, first.work.bytes + std::int64_t{kNumFactors} * 40);
}

}  // namespace
}  // namespace inceres
