#include "linearize/row_products.h"

#include <gtest/gtest.h>

#include "support/core_pipeline.h"
#include "support/dense_oracle.h"
#include "support/random_graph.h"

namespace inceres::internal {
namespace {

using test::BundleOptions;
using test::CorePipeline;
using test::MakeBundle;

TEST(MultiplyJacobian, EqualsTheDenseOracle) {
  BundleOptions options;
  options.num_frames = 9;
  options.frame_sizes = {6, 15, 9};
  options.landmark_sizes = {3, 1, 4};
  options.manifolds = true;
  options.losses = true;
  options.constants = true;
  const auto bundle = MakeBundle(options);
  const CorePipeline core(bundle->graph());
  const test::DenseOracle oracle(bundle->graph(), core.layout.variables);
  const std::vector<double> v =
      bundle->random().Vector(static_cast<std::size_t>(core.layout.size()));
  const Eigen::VectorXd Jv =
      oracle.J * Eigen::Map<const Eigen::VectorXd>(v.data(), core.layout.size());
  const RowProducts products = MultiplyJacobian(core.evaluator, v.data());
  EXPECT_NEAR(products.squared_norm, Jv.squaredNorm(), 1e-12 * Jv.squaredNorm());
  EXPECT_NEAR(products.model_decrease, -Jv.dot(oracle.f + 0.5 * Jv), 1e-12 * Jv.squaredNorm());
}

TEST(MultiplyJacobian, SameBitsForAnyNumberOfThreads) {
  BundleOptions options;
  options.num_landmarks = 1500;  // several chunks of factors
  const auto bundle = MakeBundle(options);
  const CorePipeline one(bundle->graph(), true, 1);
  const std::vector<double> v =
      bundle->random().Vector(static_cast<std::size_t>(one.layout.size()));
  const RowProducts expected = MultiplyJacobian(one.evaluator, v.data());
  for (const int num_threads : {2, 4}) {
    const CorePipeline many(bundle->graph(), true, num_threads);
    const RowProducts actual = MultiplyJacobian(many.evaluator, v.data());
    EXPECT_EQ(actual.model_decrease, expected.model_decrease);
    EXPECT_EQ(actual.squared_norm, expected.squared_norm);
  }
}

}  // namespace
}  // namespace inceres::internal
