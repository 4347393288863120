// NumericDiffFamily: differences against derivatives written down.

#include "inceres/autodiff/numeric_diff_family.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

namespace inceres {
namespace {

// What no Jet can go through: it knows doubles only.
struct WaveFunctor {
  bool operator()(const double* a, const double* b, double* residuals) const {
    residuals[0] = std::sin(a[0]) * b[1] + offset;
    residuals[1] = std::exp(a[1] * b[0]);
    return a[0] < limit;
  }
  double offset = 0.0;
  double limit = 100.0;
};
using Waves = NumericDiffFamily<WaveFunctor, 2, 2, 3>;

struct WaveEvaluation {
  explicit WaveEvaluation(const Waves& waves, bool wants_a = true) {
    const double* parameters[] = {a, b};
    double* jacobians[] = {wants_a ? J_a : nullptr, J_b};
    evaluated = waves.EvaluateOne(0, parameters, residuals, jacobians);
  }
  const double a[2] = {0.7, -0.4};
  const double b[3] = {1.1, 2.5, 1e6};
  double residuals[2] = {};
  double J_a[4] = {9.0, 9.0, 9.0, 9.0};
  double J_b[6] = {};
  bool evaluated = false;
};

void ExpectWaveDerivatives(const WaveEvaluation& wave, double tolerance) {
  const double* a = wave.a;
  const double* b = wave.b;
  const double e = std::exp(a[1] * b[0]);
  const double expected_a[4] = {std::cos(a[0]) * b[1], 0.0, 0.0, b[0] * e};
  const double expected_b[6] = {0.0, std::sin(a[0]), 0.0, a[1] * e, 0.0, 0.0};
  for (int k = 0; k < 4; ++k) {
    EXPECT_NEAR(wave.J_a[k], expected_a[k], tolerance) << k;
  }
  for (int k = 0; k < 6; ++k) {
    EXPECT_NEAR(wave.J_b[k], expected_b[k], tolerance) << k;
  }
}

TEST(NumericDiffFamily, CentralDifferences) {
  Waves waves("wave");
  waves.Add({3.0});
  const WaveEvaluation wave(waves);
  ASSERT_TRUE(wave.evaluated);
  EXPECT_EQ(wave.residuals[0], std::sin(0.7) * 2.5 + 3.0);
  ExpectWaveDerivatives(wave, 1e-8);
}

TEST(NumericDiffFamily, ForwardDifferencesErrMore) {
  Waves waves("wave");
  ASSERT_TRUE(waves.SetOptions({NumericDiffMethod::kForward, 1e-4}).ok());
  waves.Add({3.0});
  const WaveEvaluation wave(waves);
  ASSERT_TRUE(wave.evaluated);
  ExpectWaveDerivatives(wave, 1e-3);
  const double error = std::fabs(wave.J_a[3] - 1.1 * std::exp(-0.44));
  EXPECT_GT(error, 1e-7);  // of the method: it has been used
}

TEST(NumericDiffFamily, OptionsAreValidated) {
  EXPECT_TRUE(NumericDiffOptions().Validate().ok());
  for (const double step : {0.0, -1.0, std::nan(""), HUGE_VAL}) {
    Waves waves("wave");
    const Status status = waves.SetOptions({NumericDiffMethod::kCentral, step});
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_NE(status.message.find("relative_step_size"), std::string::npos);
  }
}

TEST(NumericDiffFamily, AConstantsJacobianIsNotFormed) {
  Waves waves("wave");
  waves.Add({3.0});
  const WaveEvaluation wave(waves, false);
  ASSERT_TRUE(wave.evaluated);
  EXPECT_EQ(wave.J_a[0], 9.0);
  EXPECT_NEAR(wave.J_b[1], std::sin(0.7), 1e-8);
}

TEST(NumericDiffFamily, AFunctorThatReturnsFalseAStepAwayFails) {
  Waves waves("wave");
  waves.Add({3.0, 0.7 + 1e-9});  // here it does not, but beyond
  const WaveEvaluation wave(waves);
  EXPECT_FALSE(wave.evaluated);
}

}  // namespace
}  // namespace inceres
