// A map from one camera, closed by a loop: its scale has drifted, and the loop's similarity puts it
// right.
#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/relative_pose.h"
#include "inceres/problem/manifolds.h"
#include "inceres/problem/rotation.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"

namespace inceres {
namespace {

constexpr int kPoses = 60;

// Around a circle of radius 10, tilted; every unit is a meter.
std::vector<double> TrueSimilarity(int i) {
  const double angle = 2.0 * M_PI * i / kPoses;
  const double phi[3] = {0.2 * std::sin(angle), 0.1, angle};
  std::vector<double> S = {10.0 * std::cos(angle),
                           10.0 * std::sin(angle),
                           std::sin(2.0 * angle),
                           0.0,
                           0.0,
                           0.0,
                           1.0,
                           1.0};
  ExpQuaternion(phi, S.data() + 3);
  return S;
}

RelativeSimilarityFamily::Measurement Measure(int a, int b, double drift) {
  double inverse[8], ab[8];
  InvertSimilarity(TrueSimilarity(a).data(), inverse);
  ComposeSimilarities(inverse, TrueSimilarity(b).data(), ab);
  RelativeSimilarityFamily::Measurement m;
  std::copy_n(ab, 3, m.p_m);
  std::copy_n(ab + 3, 4, m.q_m);
  m.s_m = ab[7] * drift;
  for (int k = 0; k < 7; ++k) {
    m.sqrt_information[8 * k] = 10.0;
  }
  return m;
}

// Odometry that shrinks by 1 % a step, and a loop that knows the scale.
FactorGraph DriftingMap(SimilarityErrorConvention convention) {
  FactorGraph graph;
  const auto family = graph.AddFamily(std::make_shared<RelativeSimilarityFamily>(convention));
  const auto manifold = std::make_shared<SimilarityManifold>();
  std::vector<double> S = TrueSimilarity(0);
  for (int i = 0; i < kPoses; ++i) {
    graph.AddVariable(S.data(), 8, Role::kFrame, manifold);
    const RelativeSimilarityFamily::Measurement step = Measure(i, (i + 1) % kPoses, 0.99);
    double motion[8], next[8];
    std::copy_n(step.p_m, 3, motion);
    std::copy_n(step.q_m, 4, motion + 3);
    motion[7] = step.s_m;
    ComposeSimilarities(S.data(), motion, next);
    S.assign(next, next + 8);
  }
  graph.SetConstant(0, true);
  for (int i = 0; i + 1 < kPoses; ++i) {
    graph.AddFactor(family, Measure(i, i + 1, 0.99), {i, i + 1});
  }
  graph.AddFactor(family, Measure(kPoses - 1, 0, 1.0), {kPoses - 1, 0});
  return graph;
}

double LargestScaleError(const FactorGraph& graph) {
  double largest = 0.0;
  for (int i = 0; i < kPoses; ++i) {
    largest = std::max(largest, std::fabs(std::log(graph.Values(i)[7])));
  }
  return largest;
}

TEST(ScaleDrift, ALoopSpreadsItOverTheRound) {
  for (const SimilarityErrorConvention convention :
       {SimilarityErrorConvention::kGeodesic, SimilarityErrorConvention::kLogarithm}) {
    SCOPED_TRACE(ToString(convention));
    FactorGraph graph = DriftingMap(convention);
    const double before = LargestScaleError(graph);
    EXPECT_NEAR(before, -(kPoses - 1) * std::log(0.99), 1e-9);
    SolverOptions options;
    options.strategy = TrustRegionStrategyKind::kDogleg;
    options.function_tolerance = 1e-12;
    options.max_num_iterations = 100;
    const Summary summary = Solve(options, &graph);
    ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
    EXPECT_LT(summary.final_cost, 0.1 * summary.initial_cost);
    // Nothing but the loop contradicts the drift, a step's share of it goes everywhere.
    EXPECT_LT(LargestScaleError(graph), 0.5 * before);

    IncrementalOptions incremental;
    incremental.function_tolerance = 1e-10;
    incremental.max_num_iterations = 200;
    IncrementalSolver solver(incremental);
    const auto family = solver.AddFamily(std::make_shared<RelativeSimilarityFamily>(convention));
    const FactorGraph start = DriftingMap(convention);
    const auto manifold = std::make_shared<SimilarityManifold>();
    for (int i = 0; i < kPoses; ++i) {
      GraphEdit edit(solver.graph());
      edit.AddVariable(start.Values(i), 8, Role::kFrame, manifold);
      if (i == 0) {
        edit.SetConstant(0, true);
      } else {
        edit.AddFactor(family, Measure(i - 1, i, 0.99), {i - 1, i});
      }
      if (i + 1 == kPoses) {
        edit.AddFactor(family, Measure(i, 0, 1.0), {i, 0});
      }
      ASSERT_TRUE(solver.Apply(edit).ok());
      ASSERT_EQ(solver.Update().termination, Termination::kConvergence);
    }
    EXPECT_NEAR(solver.cost(), summary.final_cost, 1e-6 * summary.final_cost);
  }
}

}  // namespace
}  // namespace inceres
