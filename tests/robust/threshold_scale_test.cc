// Thresholds: quantiles of χ², and how far they are off, as the errors of inliers tell.
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/gnc.h"
#include "robust/gnc_worlds.h"
#include "robust/scaled_thresholds.h"

namespace inceres {
namespace {

using internal::kTightTails;
using internal::ThresholdScale;
using test::GncWorld;
using test::PoseGraphWorld;

std::vector<double> ChiSquareErrors(int count, int degrees, double sigma, unsigned seed) {
  std::mt19937 engine(seed);
  std::normal_distribution<double> normal(0.0, sigma);
  std::vector<double> errors(count);
  for (double& error : errors) {
    for (int k = 0; k < degrees; ++k) {
      const double f = normal(engine);
      error += f * f;
    }
  }
  return errors;
}

TEST(ThresholdScale, IsThatOfTheErrors) {
  for (const int degrees : {1, 3, 6}) {
    for (const double sigma : {0.3, 0.01}) {
      std::vector<double> errors = ChiSquareErrors(2000, degrees, sigma, 5);
      const double expected = kTightTails * sigma * sigma;
      EXPECT_NEAR(ThresholdScale(degrees, &errors), expected, 0.15 * expected) << degrees;
      // a few wrong ones do not matter
      errors.insert(errors.end(), 40, 100.0);
      EXPECT_NEAR(ThresholdScale(degrees, &errors), expected, 0.35 * expected) << degrees;
    }
  }
}

TEST(ThresholdScale, IsNeverAboveOneAndNeedsErrors) {
  std::vector<double> errors = ChiSquareErrors(500, 3, 2.0, 1);
  EXPECT_EQ(ThresholdScale(3, &errors), 1.0);
  errors.assign(19, 1e-6);
  EXPECT_EQ(ThresholdScale(3, &errors), 1.0);
  errors.assign(20, 0.0);
  const double least = ThresholdScale(3, &errors);
  EXPECT_GT(least, 0.0);
  EXPECT_LE(least, 1e-6);
}

// Every graduation begins with all weights 1, which is before it: no μ is told, not that of the
// graduation before either.
void ExpectNoMuAtFullWeights(const GncSummary& summary, int num_suspects) {
  int num_begun = 0;
  for (const GncRound& round : summary.rounds) {
    if (round.num_full == num_suspects) {
      EXPECT_EQ(round.mu, 0.0);
      ++num_begun;
    }
  }
  EXPECT_GE(num_begun, 1);
}

// Information that promises errors thirty times as large as they are: a wrong loop at the end of a
// chain is then taken for right, unless the scale is estimated.
TEST(ThresholdScale, FindsWrongLoopsUnderLooseInformation) {
  for (const int dimension : {2, 3}) {
    PoseGraphWorld world(dimension, 200, 40, 8, 0.02, 7);
    for (PoseGraphEdge& edge : world.truth.edges) {
      for (double& entry : edge.information) {
        entry *= 1e-3;
      }
    }
    int missed[2] = {};
    for (const bool estimate : {false, true}) {
      GncWorld loose(world);
      GncOptions options = loose.Options();
      options.estimate_scale = estimate;
      const GncSummary summary = SolveGnc(options, loose.suspects, &loose.graph);
      ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
      ExpectNoMuAtFullWeights(summary, static_cast<int>(loose.suspects.size()));
      int lost = 0;
      for (std::size_t k = 0; k < loose.suspects.size(); ++k) {
        const GncVerdict& verdict = summary.verdicts[k];
        missed[estimate ? 1 : 0] += loose.IsWrong(k) && verdict.inlier ? 1 : 0;
        lost += !loose.IsWrong(k) && !verdict.inlier ? 1 : 0;
      }
      EXPECT_LE(lost, 2) << dimension;
      const double nominal = ChiSquareQuantile(options.inlier_probability, dimension == 2 ? 3 : 6);
      if (estimate) {
        EXPECT_LT(summary.verdicts[0].threshold, 0.05 * nominal);
      } else {
        EXPECT_EQ(summary.verdicts[0].threshold, nominal);
      }
    }
    EXPECT_GT(missed[0], 0) << dimension;
    EXPECT_EQ(missed[1], 0) << dimension;
  }
}

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
