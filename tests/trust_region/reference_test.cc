// Iteration by iteration against Ceres's loop written down with dense matrices.
#include <cmath>
#include <functional>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"
#include "linearize/layout.h"
#include "support/classic_problems.h"
#include "support/random_graph.h"
#include "trust_region/reference_trust_region.h"

namespace inceres {
namespace {

using test::BundleOptions;
using test::MakeBundle;
using test::ReferenceTrace;

struct ReferenceCase {
  std::string name;
  TrustRegionStrategyKind strategy;
  bool nonmonotonic;
};

class AgainstReference : public testing::TestWithParam<ReferenceCase> {
 protected:
  AgainstReference() {
    options_.strategy = GetParam().strategy;
    options_.use_nonmonotonic_steps = GetParam().nonmonotonic;
    options_.initial_trust_region_radius = 10.0;  // small enough for the radius to matter
  }

  // Where tolerances decide between equals, rounding may shift the end by one iteration.
  void ExpectSameTrace(FactorGraph* graph, LinearModelKind model, double tolerance) {
    options_.linear_model = model;
    const internal::Layout layout(*graph, model == LinearModelKind::kAutomatic);
    const ReferenceTrace reference = test::RunReference(options_, layout.variables, *graph);
    const Summary summary = Solve(options_, graph);
    EXPECT_EQ(summary.termination, reference.termination) << summary.message;
    EXPECT_GE(reference.iterations.size(), 4u) << "says little";
    EXPECT_LE(std::abs(static_cast<int>(summary.iterations.size()) -
                       static_cast<int>(reference.iterations.size())),
              1);
    double scale = reference.iterations.front().cost;
    for (std::size_t k = 0; k < std::min(summary.iterations.size(), reference.iterations.size());
         ++k) {
      const IterationSummary& ours = summary.iterations[k];
      const IterationSummary& theirs = reference.iterations[k];
      scale = std::min(scale, theirs.cost);
      ASSERT_NEAR(ours.cost, theirs.cost, tolerance * theirs.cost + 1e-15) << "iteration " << k;
      if (std::fabs(theirs.cost_change) > 1e-8 * theirs.cost || k == 0) {
        EXPECT_EQ(ours.step_is_successful, theirs.step_is_successful) << "iteration " << k;
        EXPECT_NEAR(ours.trust_region_radius, theirs.trust_region_radius,
                    1e-5 * theirs.trust_region_radius)
            << "iteration " << k;
        EXPECT_NEAR(ours.step_norm, theirs.step_norm, 1e-6 * theirs.step_norm) << "iteration " << k;
        EXPECT_NEAR(ours.gradient_max_norm, theirs.gradient_max_norm,
                    1e-6 * theirs.gradient_max_norm + 1e-9)
            << "iteration " << k;
      }
    }
    for (std::size_t k = 0; k < reference.state.size(); ++k) {
      EXPECT_NEAR(graph->state()[k], reference.state[k],
                  1e-4 * (1.0 + std::fabs(reference.state[k])))
          << "value " << k;
    }
  }

  SolverOptions options_;
};

TEST_P(AgainstReference, CurveFitPlainAndByQr) {
  for (const LinearModelKind model : {LinearModelKind::kPlain, LinearModelKind::kDenseQr}) {
    for (const bool robust : {false, true}) {
      FactorGraph graph;
      test::MakeCurveFit(&graph, robust ? std::make_shared<CauchyLoss>(0.5) : nullptr, robust);
      ExpectSameTrace(&graph, model, 1e-9);
    }
  }
}

TEST_P(AgainstReference, Rosenbrock) {
  for (const LinearModelKind model : {LinearModelKind::kPlain, LinearModelKind::kDenseQr}) {
    FactorGraph graph;
    test::MakeRosenbrock(&graph);
    options_.max_num_iterations = 12;  // then the cost is rounding
    ExpectSameTrace(&graph, model, 1e-8);
  }
}

TEST_P(AgainstReference, BundlesOfEveryLandmarkSize) {
  for (int size = 1; size <= 4; ++size) {
    BundleOptions bundle;
    bundle.seed = static_cast<unsigned>(50 + size);
    bundle.landmark_sizes = {size};
    bundle.perturbation = 2.0;
    ExpectSameTrace(&MakeBundle(bundle)->graph(), LinearModelKind::kAutomatic, 1e-9);
  }
}

TEST_P(AgainstReference, BundleWithEverything) {
  BundleOptions bundle;
  bundle.num_frames = 8;
  bundle.landmark_sizes = {3, 1, 4, 2};
  bundle.frame_sizes = {6, 9, 15};
  bundle.residual_sizes = {2, 3, 5};
  bundle.hosted = bundle.manifolds = bundle.losses = bundle.constants = true;
  bundle.perturbation = 1.0;
  for (const LinearModelKind model :
       {LinearModelKind::kAutomatic, LinearModelKind::kPlain, LinearModelKind::kDenseQr}) {
    ExpectSameTrace(&MakeBundle(bundle)->graph(), model, 1e-9);
  }
}

TEST_P(AgainstReference, WithoutJacobiScaling) {
  BundleOptions bundle;
  bundle.perturbation = 2.0;
  options_.jacobi_scaling = false;
  ExpectSameTrace(&MakeBundle(bundle)->graph(), LinearModelKind::kAutomatic, 1e-9);
}

INSTANTIATE_TEST_SUITE_P(
    Strategies, AgainstReference,
    testing::Values(ReferenceCase{"LevenbergMarquardt",
                                  TrustRegionStrategyKind::kLevenbergMarquardt, false},
                    ReferenceCase{"Dogleg", TrustRegionStrategyKind::kDogleg, false},
                    ReferenceCase{"LevenbergMarquardtNonmonotonic",
                                  TrustRegionStrategyKind::kLevenbergMarquardt, true},
                    ReferenceCase{"DoglegNonmonotonic", TrustRegionStrategyKind::kDogleg, true}),
    [](const auto& instance) { return instance.param.name; });

}  // namespace
}  // namespace inceres
