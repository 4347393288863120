#include <cmath>

#include <gtest/gtest.h>

#include "inceres/solver/gnc.h"

namespace inceres {
namespace {

// Tables: NIST/SEMATECH e-Handbook of Statistical Methods, section 1.3.6.7.4; two degrees in closed
// form.
TEST(ChiSquareQuantile, AgreesWithTables) {
  EXPECT_NEAR(ChiSquareQuantile(0.95, 1), 3.841458820694124, 1e-11);
  EXPECT_NEAR(ChiSquareQuantile(0.99, 3), 11.344866730144373, 1e-10);
  EXPECT_NEAR(ChiSquareQuantile(0.99, 6), 16.811893829770927, 1e-10);
  EXPECT_NEAR(ChiSquareQuantile(0.05, 10), 3.940299136, 1e-8);
  EXPECT_NEAR(ChiSquareQuantile(0.999, 100), 149.449, 1e-3);
}

TEST(ChiSquareQuantile, IsThatOfTheExponentialDistributionForTwoDegrees) {
  for (const double probability : {1e-9, 0.01, 0.3, 0.5, 0.9, 0.999999}) {
    const double exact = -2.0 * std::log1p(-probability);
    EXPECT_NEAR(ChiSquareQuantile(probability, 2), exact, 1e-9 * exact) << probability;
  }
}

}  // namespace
}  // namespace inceres
