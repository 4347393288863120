#pragma once

#include <gtest/gtest.h>

#include "inceres/solver/summary.h"

namespace inceres::test {

/// Two solves that took the same path, to the last bit.
inline void ExpectSameBits(const Summary& a, const Summary& b) {
  EXPECT_EQ(a.termination, b.termination);
  EXPECT_EQ(a.message, b.message);
  EXPECT_EQ(a.initial_cost, b.initial_cost);
  EXPECT_EQ(a.final_cost, b.final_cost);
  ASSERT_EQ(a.iterations.size(), b.iterations.size());
  for (std::size_t k = 0; k < a.iterations.size(); ++k) {
    const IterationSummary& p = a.iterations[k];
    const IterationSummary& q = b.iterations[k];
    EXPECT_EQ(p.cost, q.cost) << "iteration " << k;
    EXPECT_EQ(p.cost_change, q.cost_change) << "iteration " << k;
    EXPECT_EQ(p.gradient_norm, q.gradient_norm) << "iteration " << k;
    EXPECT_EQ(p.gradient_max_norm, q.gradient_max_norm) << "iteration " << k;
    EXPECT_EQ(p.step_norm, q.step_norm) << "iteration " << k;
    EXPECT_EQ(p.relative_decrease, q.relative_decrease) << "iteration " << k;
    EXPECT_EQ(p.trust_region_radius, q.trust_region_radius) << "iteration " << k;
    EXPECT_EQ(p.step_is_successful, q.step_is_successful) << "iteration " << k;
  }
}

}  // namespace inceres::test
