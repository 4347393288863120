#pragma once

#include <cmath>

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include "inceres/autodiff/jet_math.h"

namespace inceres::test {

// Whether the compiler may round a b + c once, here and there as it likes.
#if defined(__FMA__) || defined(__aarch64__)
constexpr double kFusedRounding = 1e-13;
#else
constexpr double kFusedRounding = 0.0;
#endif

// Equal, or two NaNs, but for the rounding of fused operations.
inline bool AreClose(double ours, double stock) {
  if (std::isnan(stock)) {
    return std::isnan(ours);
  }
  return ours == stock || std::fabs(ours - stock) <= kFusedRounding * std::fabs(stock);
}

// Value and derivatives.
template <int N>
void ExpectSame(const Jet<N>& ours, const ceres::Jet<double, N>& stock, const char* what) {
  EXPECT_TRUE(AreClose(ours.a, stock.a)) << what << ": " << ours << " where Ceres has " << stock;
  for (int i = 0; i < N; ++i) {
    EXPECT_TRUE(AreClose(ours.v[i], stock.v[i]))
        << what << ", derivative " << i << ": " << ours << " where Ceres has " << stock;
  }
}

template <int N>
ceres::Jet<double, N> ToStock(const Jet<N>& ours) {
  ceres::Jet<double, N> stock(ours.a);
  for (int i = 0; i < N; ++i) {
    stock.v[i] = ours.v[i];
  }
  return stock;
}

}  // namespace inceres::test
