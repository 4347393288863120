// Factors that are expansions about a point of their own, which solvers let them move between
// iterations (FactorFamily::Recenter), against the same problem with the functions themselves.
#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "support/test_families.h"
#include "support/values_held.h"
#include "trust_region/same_bits.h"

namespace inceres {
namespace {

constexpr double kLimit = 1e-4;
constexpr int kCount = 12;

// y − h(x) with h(x) = x + 2 sin x, either as it is or expanded about a center c of its own: h(c) +
// h'(c) (x − c).
class ExpandedFamily final : public AmbientFamily<ExpandedFamily> {
 public:
  using Measurement = double;  // the first center

  explicit ExpandedFamily(bool expands) : AmbientFamily(1, {{1, 1}, {1, 1}}), expands_(expands) {}
  void Place(int index, Measurement center) {
    if (index == size()) {
      centers_.push_back(std::make_unique<double>(center));
    }
    *centers_[index] = center;
  }
  void Add(Measurement center) { Place(size(), center); }
  int size() const override { return static_cast<int>(centers_.size()); }
  const char* Name() const override { return "expanded"; }
  bool Recenters() const override { return expands_; }
  bool Recenter(int factor, const double* const* parameters) const override {
    ++num_calls;
    const double x = parameters[0][0];
    if (std::fabs(x - *centers_[factor]) <= kLimit) {
      return false;
    }
    *centers_[factor] = x;
    return true;
  }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const double x = parameters[0][0];
    const double c = expands_ ? *centers_[i] : x;
    residuals[0] = parameters[1][0] - (c + 2.0 * std::sin(c)) - (1.0 + 2.0 * std::cos(c)) * (x - c);
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = -1.0 - 2.0 * std::cos(c);
    }
    if (jacobians != nullptr && jacobians[1] != nullptr) {
      jacobians[1][0] = 1.0;
    }
    return true;
  }
  double center(int i) const { return *centers_[i]; }

  mutable int num_calls = 0;

 private:
  bool expands_;
  std::vector<std::unique_ptr<double>> centers_;
};

// Pairs (x_i, y_i) coupled by the family, x_i drawn to its successor, y_i to a measured value:
// residuals do not vanish.
struct Chain {
  explicit Chain(bool expands)
      : expanded{-1, std::make_shared<ExpandedFamily>(expands)},
        links{-1, Difference(0.5, 0.2)},
        anchors{-1, Anchor()} {}

  static std::shared_ptr<test::FunctionFamily> Difference(double weight, double offset) {
    return test::ScalarFamily([=](double a, double b) { return weight * (b - a - offset); },
                              -weight, weight);
  }
  static std::shared_ptr<test::FunctionFamily> Anchor() {
    return test::ScalarFamily([](int i, double y) { return y - 0.3 * i - std::cos(3.0 * i); }, 1.0);
  }

  // Owner is a FactorGraph or an IncrementalSolver.
  template <typename Owner>
  void AddFamilies(Owner* owner) {
    expanded = owner->AddFamily(expanded.family);
    links = owner->AddFamily(links.family);
    anchors = owner->AddFamily(anchors.family);
  }

  // Builder is a FactorGraph or a GraphEdit.
  template <typename Builder>
  void AddPair(Builder* builder) {
    const double x = 0.4 + 0.05 * static_cast<double>(xs.size());
    const double y = 0.0;
    xs.push_back(builder->AddVariable(&x, 1, Role::kFrame));
    ys.push_back(builder->AddVariable(&y, 1, Role::kFrame));
    builder->AddFactor(expanded, 0.0, {xs.back(), ys.back()});
    builder->AddFactor(anchors, 0, {ys.back()});
    if (xs.size() > 1) {
      builder->AddFactor(links, 0, {xs[xs.size() - 2], xs.back()});
    }
  }

  FamilyHandle<ExpandedFamily> expanded;
  FamilyHandle<test::FunctionFamily> links;
  FamilyHandle<test::FunctionFamily> anchors;
  std::vector<VariableId> xs;
  std::vector<VariableId> ys;
};

FactorGraph MakeGraph(Chain* chain, int count = kCount) {
  FactorGraph graph;
  chain->AddFamilies(&graph);
  for (int i = 0; i < count; ++i) {
    chain->AddPair(&graph);
  }
  return graph;
}

SolverOptions Tight() {
  SolverOptions options;
  options.function_tolerance = 1e-14;
  options.gradient_tolerance = 1e-12;
  options.max_num_iterations = 200;
  return options;
}

double ReferenceCost() {
  Chain chain(/*expands=*/false);
  FactorGraph graph = MakeGraph(&chain);
  const Summary summary = Solve(Tight(), &graph);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(chain.expanded->num_calls, 0) << "a family that does not recenter was asked to";
  EXPECT_EQ(summary.work.num_recentered_factors, 0);
  EXPECT_GT(summary.final_cost, 0.1)
      << "residuals vanish: costs of different functions would be alike";
  return summary.final_cost;
}

// Of the factors as they are now, at the values of the graph.
double CostNow(const FactorGraph& graph) {
  FactorGraph copy = graph;
  for (VariableId id = 0; id < copy.num_variables(); ++id) {
    copy.SetConstant(id, true);
  }
  return Solve(Tight(), &copy).final_cost;
}

TEST(Recenter, ABatchSolveEndsWithEveryCenterAtItsValue) {
  for (const TrustRegionStrategyKind strategy :
       {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kDogleg}) {
    for (const bool nonmonotonic : {false, true}) {
      Chain chain(/*expands=*/true);
      FactorGraph graph = MakeGraph(&chain);
      SolverOptions options = Tight();
      options.strategy = strategy;
      options.use_nonmonotonic_steps = nonmonotonic;
      const Summary summary = Solve(options, &graph);
      EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      EXPECT_GT(summary.work.num_recentered_factors, kCount) << "more than at the start";
      for (int i = 0; i < kCount; ++i) {
        EXPECT_LE(std::fabs(chain.expanded->center(i) - graph.Values(chain.xs[i])[0]), kLimit);
      }
      EXPECT_NEAR(summary.final_cost, CostNow(graph), 1e-13)
          << "the cost of what the factors were once";
      EXPECT_NEAR(summary.final_cost, ReferenceCost(), 1e-6);
      EXPECT_GT(summary.initial_cost, summary.final_cost);
    }
  }
}

// Where the expansion is nearly flat a step goes far, to a place where the function expanded anew
// is larger than at the start.
TEST(Recenter, TheFinalCostIsThatOfTheFactorsAsTheyAreNow) {
  Chain chain(/*expands=*/true);
  FactorGraph graph;
  chain.AddFamilies(&graph);
  chain.AddPair(&graph);
  const double flat = 2.0;
  graph.SetValues(chain.xs[0], &flat);
  SolverOptions options = Tight();
  options.max_num_iterations = 1;
  const Summary summary = Solve(options, &graph);
  ASSERT_EQ(summary.termination, Termination::kNoConvergence) << summary.message;
  EXPECT_GT(summary.final_cost, summary.initial_cost);
  EXPECT_NEAR(summary.final_cost, CostNow(graph), 1e-9);
}

// What the factors of a large family need is looked up by variable, but not of one that recenters:
// a solver that has solved the same problem without expansions has no tables for it.
TEST(Recenter, ASolverThatHasSolvedWithoutExpansionsSetsUpAnew) {
  constexpr int kMany = 5000;
  SolverOptions options;
  options.max_num_iterations = 3;
  options.recompute_jacobians = true;
  Chain by_itself(/*expands=*/true);
  FactorGraph expected_graph = MakeGraph(&by_itself, kMany);
  const Summary expected = Solve(options, &expected_graph);
  ASSERT_TRUE(expected.IsSolutionUsable()) << expected.message;
  Solver solver;
  Chain functions(/*expands=*/false);
  FactorGraph before = MakeGraph(&functions, kMany);
  ASSERT_TRUE(solver.Solve(options, &before).recomputed_jacobians);
  for (const bool known : {false, true}) {
    Chain chain(/*expands=*/true);
    FactorGraph graph = MakeGraph(&chain, kMany);
    EXPECT_EQ(solver.IsReadyFor(options, graph), known);
    const Summary summary = solver.Solve(options, &graph);
    EXPECT_EQ(summary.structure_reused, known);
    EXPECT_GE(summary.work.num_recentered_factors, kMany);
    test::ExpectSameBits(summary, expected);
    EXPECT_EQ(graph.state(), expected_graph.state());
  }
}

TEST(Recenter, IncrementalUpdatesEndWithEveryCenterAtItsValue) {
  for (const double batch_share : {0.5, 1.0}) {
    IncrementalOptions options;
    options.batch_share = batch_share;
    options.function_tolerance = 1e-12;
    IncrementalSolver solver(options);
    Chain chain(/*expands=*/true);
    chain.AddFamilies(&solver);
    int num_recentered = 0;
    for (int i = 1; i < kCount; ++i) {
      GraphEdit edit(solver.graph());
      chain.AddPair(&edit);
      if (i == 1) {
        chain.AddPair(&edit);  // one alone would have a cost of 0
      }
      ASSERT_TRUE(solver.Apply(edit).ok());
      const UpdateSummary summary = solver.Update();
      ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      num_recentered += summary.num_recentered_factors;
      const FactorGraph now = test::AtValuesHeld(solver);
      for (int k = 0; k <= i; ++k) {
        EXPECT_LE(std::fabs(chain.expanded->center(k) - solver.Values(chain.xs[k])[0]), kLimit);
      }
      EXPECT_NEAR(summary.final_cost, CostNow(now), 1e-13);
    }
    EXPECT_GT(num_recentered, kCount);
    EXPECT_NEAR(solver.cost(), ReferenceCost(), 1e-6);
  }
}

}  // namespace
}  // namespace inceres
