// Radius and regularization rules, and when the linear system is solved anew.
#include <cmath>
#include <memory>

#include <gtest/gtest.h>

#include "support/core_pipeline.h"
#include "support/random_graph.h"
#include "trust_region/strategy.h"

namespace inceres::internal {
namespace {

// A model over a real linearization that records the damping it is asked for and refuses the first
// `num_refusals` solves.
class RecordingModel final : public LinearModel {
 public:
  explicit RecordingModel(const test::CorePipeline& core)
      : LinearModel(core.evaluator), core_(core) {}
  void Refresh() override {}
  const std::vector<double>& Gradient() const override { return core_.hessian.gradient(); }
  const std::vector<double>& Diagonal() const override { return core_.hessian.diagonal(); }
  Status Solve(const double* damping, double* step) override {
    dampings.emplace_back(damping, damping + core_.layout.size());
    if (num_refusals-- > 0) {
      return Status::Error(refusal, "refused");
    }
    std::copy(answer.begin(), answer.end(), step);
    return Status::Ok();
  }
  const char* SolverName() const override { return "recording"; }
  void Describe(WorkCounts*) const override {}

  std::vector<std::vector<double>> dampings;
  std::vector<double> answer;
  int num_refusals = 0;
  StatusCode refusal = StatusCode::kSingular;

 private:
  const test::CorePipeline& core_;
};

class Strategies : public testing::Test {
 protected:
  Strategies() {
    const VariableId x = random_.AddFrame(3);
    random_.Connect(4, {x});
    core_ = std::make_unique<test::CorePipeline>(random_.graph());
    model_ = std::make_unique<RecordingModel>(*core_);
    model_->answer = {0.1, -0.2, 0.3};
    JacobiScale(model_->Diagonal(), true, HUGE_VAL, &scale_);
    step_.resize(3);
  }

  void Make(TrustRegionStrategyKind kind) {
    options_.strategy = kind;
    StartStrategy(options_, scale_, &strategy_);
  }
  Status Step() { return strategy_->ComputeStep(model_.get(), step_.data(), &num_solves_); }

  test::RandomGraph random_{6};
  std::unique_ptr<test::CorePipeline> core_;
  std::unique_ptr<RecordingModel> model_;
  SolverOptions options_;
  std::vector<double> scale_;
  std::unique_ptr<TrustRegionStrategy> strategy_;
  std::vector<double> step_;
  int num_solves_ = 0;
};

TEST_F(Strategies, JacobiScale) {
  std::vector<double> scale(5, 7.0);
  JacobiScale({0.0, 9.0}, true, HUGE_VAL, &scale);
  EXPECT_EQ(scale, (std::vector<double>{1.0, 0.25}));
  JacobiScale({0.0, 9.0}, false, HUGE_VAL, &scale);
  EXPECT_EQ(scale, (std::vector<double>{1.0, 1.0}));
  JacobiScale({0.0, 1e30, 9.0}, true, 7.0, &scale);
  EXPECT_EQ(scale, (std::vector<double>{1.0, 0.125, 0.25}));
}

// A column that was far longer when the scale was taken is damped by more than its diagonal, and a
// solve that began now would not hold it.
TEST_F(Strategies, HeldBackTellsOfAColumnThatIsClampedByItsScale) {
  const std::vector<double>& H = model_->Diagonal();
  scale_[0] = 1e-15;
  options_.initial_trust_region_radius = 8.0;
  Make(TrustRegionStrategyKind::kLevenbergMarquardt);
  ASSERT_TRUE(Step().ok());
  const double clamped = options_.min_lm_diagonal / (8.0 * 1e-30);
  const double anew = H[0] / 8.0;
  ASSERT_GT(clamped, 1e20 * anew);
  const double expected =
      clamped * (clamped / anew) * 0.1 * 0.1 + H[1] / 8.0 * 0.2 * 0.2 + H[2] / 8.0 * 0.3 * 0.3;
  EXPECT_NEAR(expected, strategy_->HeldBack(*model_, step_), 1e-12 * expected);
}

TEST_F(Strategies, IsFinite) {
  EXPECT_TRUE(IsFinite({1.0, -2.0}));
  EXPECT_FALSE(IsFinite({1.0, std::nan("")}));
  EXPECT_FALSE(IsFinite({HUGE_VAL}));
}

TEST_F(Strategies, LevenbergMarquardtRadius) {
  options_.initial_trust_region_radius = 8.0;
  options_.max_trust_region_radius = 30.0;
  Make(TrustRegionStrategyKind::kLevenbergMarquardt);
  strategy_->StepAccepted(0.5);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 8.0);
  strategy_->StepAccepted(1.0);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 24.0);
  strategy_->StepAccepted(5.0);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 30.0);  // clamped
  strategy_->StepRejected();
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 15.0);
  strategy_->StepIsInvalid();
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 3.75);
  strategy_->StepAccepted(0.25);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 3.75 / 1.125);
  strategy_->StepRejected();
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 3.75 / 1.125 / 2.0);  // the factor started anew
}

// Ten times the damping after refusals, a tenth after steps that keep their promise; after
// refusals in a row, however many, the radius grows by the root of that, until four steps in a row
// are taken.
TEST_F(Strategies, MarquardtsRule) {
  options_.initial_trust_region_radius = 1.0;
  options_.max_trust_region_radius = 1e6;
  Make(TrustRegionStrategyKind::kMarquardt);
  strategy_->StepAccepted(1.0);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 10.0);
  strategy_->StepAccepted(0.1);  // kept little of its promise
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 10.0);
  strategy_->StepRejected();
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 1.0);  // as before it grew
  strategy_->StepRejected();
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 0.1);
  const double slower = std::sqrt(10.0);
  for (int k = 1; k <= 3; ++k) {
    strategy_->StepAccepted(1.0);
    EXPECT_NEAR(strategy_->Radius(), 0.1 * std::pow(slower, k), 1e-9);
  }
  strategy_->StepAccepted(1.0);
  EXPECT_NEAR(strategy_->Radius(), 0.1 * std::pow(slower, 5), 1e-9);
  for (int k = 0; k < 40; ++k) {
    strategy_->StepAccepted(1.0);
  }
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 1e6);  // clamped
}

TEST_F(Strategies, AWidenedRadiusIsTakenBackByARefusal) {
  options_.initial_trust_region_radius = 8.0;
  for (const auto kind :
       {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kMarquardt}) {
    Make(kind);
    strategy_->Widen(2.0);  // it is wider
    EXPECT_DOUBLE_EQ(strategy_->Radius(), 8.0);
    strategy_->Widen(1e8);
    EXPECT_DOUBLE_EQ(strategy_->Radius(), 1e8);
    strategy_->StepRejected();
    EXPECT_DOUBLE_EQ(strategy_->Radius(), 8.0);
    strategy_->StepRejected();
    const double narrow = strategy_->Radius();
    EXPECT_LT(narrow, 8.0);
    strategy_->Widen(1e8);
    strategy_->StepAccepted(1.0);
    EXPECT_GT(strategy_->Radius(), 1e8);
    strategy_->StepRejected();  // one step does not prove it
    EXPECT_DOUBLE_EQ(strategy_->Radius(), narrow);
    strategy_->Widen(1e8);
    strategy_->StepAccepted(1.0);
    strategy_->StepAccepted(1.0);
    strategy_->StepRejected();
    EXPECT_GT(strategy_->Radius(), 8.0);
  }
}

// A strategy that goes on from what another one saved does what that one does, whatever came
// before: above all it takes back a width that no step has proved.
TEST_F(Strategies, WhatIsRestoredGoesOnAsWhatWasSaved) {
  options_.initial_trust_region_radius = 8.0;
  for (const auto kind :
       {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kMarquardt}) {
    for (const int num_accepted : {0, 1, 2}) {
      Make(kind);
      strategy_->StepRejected();
      strategy_->Widen(1e8);
      for (int k = 0; k < num_accepted; ++k) {
        strategy_->StepAccepted(1.0);
      }
      std::unique_ptr<TrustRegionStrategy> other;
      StartStrategy(options_, scale_, &other);
      ASSERT_TRUE(other->Restore(strategy_->Save()));
      for (const bool accepted : {false, true, true, false, false, true}) {
        for (TrustRegionStrategy* each : {strategy_.get(), other.get()}) {
          accepted ? each->StepAccepted(0.9) : each->StepRejected();
        }
        EXPECT_EQ(other->Radius(), strategy_->Radius()) << num_accepted << " accepted before";
      }
    }
    EXPECT_FALSE(strategy_->Restore({8.0, 2.0, 10.0, 0.0})) << "not all of it";
  }
}

// Nothing is left of what refusals have taught.
TEST_F(Strategies, ARestartedRadiusGrowsTenfoldAgain) {
  options_.initial_trust_region_radius = 1.0;
  options_.max_trust_region_radius = 1e6;
  Make(TrustRegionStrategyKind::kMarquardt);
  strategy_->StepRejected();
  strategy_->StepRejected();
  strategy_->Widen(1e3);
  strategy_->Restart(10.0);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 10.0);
  strategy_->StepAccepted(1.0);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 100.0);
  strategy_->StepRejected();
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 10.0);
  strategy_->Restart(1e9);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 1e6);  // clamped
}

TEST_F(Strategies, LevenbergMarquardtDampingIsClampedInScaledColumns) {
  options_.initial_trust_region_radius = 2.0;
  options_.min_lm_diagonal = 0.3;
  options_.max_lm_diagonal = 0.35;
  Make(TrustRegionStrategyKind::kLevenbergMarquardt);
  ASSERT_TRUE(Step().ok());
  EXPECT_EQ(step_, model_->answer);
  for (std::size_t j = 0; j < 3; ++j) {
    const double s = scale_[j];
    const double clamped = std::min(std::max(s * s * model_->Diagonal()[j], 0.3), 0.35);
    EXPECT_DOUBLE_EQ(model_->dampings[0][j] * s * s * 2.0, clamped);
  }
}

TEST_F(Strategies, DoglegRaisesMuUntilTheSystemCanBeFactored) {
  Make(TrustRegionStrategyKind::kDogleg);
  model_->num_refusals = 3;
  ASSERT_TRUE(Step().ok());
  ASSERT_EQ(num_solves_, 4);
  for (std::size_t k = 1; k < 4; ++k) {
    EXPECT_NEAR(model_->dampings[k][0] / model_->dampings[k - 1][0], 10.0, 1e-9);
  }
  const double D2_over_s2 =
      std::max(1e-6, scale_[0] * scale_[0] * model_->Diagonal()[0]) / (scale_[0] * scale_[0]);
  EXPECT_NEAR(model_->dampings[0][0], 1e-8 * D2_over_s2, 1e-20);
  strategy_->StepAccepted(0.5);  // μ falls by five
  ASSERT_TRUE(Step().ok());
  EXPECT_NEAR(model_->dampings[4][0] / model_->dampings[3][0], 0.2, 1e-9);
}

TEST_F(Strategies, DoglegGivesUpWhenMuReachesOne) {
  Make(TrustRegionStrategyKind::kDogleg);
  model_->num_refusals = 100;
  EXPECT_EQ(Step().code, StatusCode::kSingular);
  EXPECT_EQ(num_solves_, 8);  // 1e-8 … 1e-1
  strategy_->StepIsInvalid();
  EXPECT_EQ(Step().code, StatusCode::kSingular);
  EXPECT_EQ(num_solves_, 8);
}

TEST_F(Strategies, DoglegPassesOnErrorsThatDampingCannotCure) {
  Make(TrustRegionStrategyKind::kDogleg);
  model_->num_refusals = 1;
  model_->refusal = StatusCode::kUnavailable;
  EXPECT_EQ(Step().code, StatusCode::kUnavailable);
  EXPECT_EQ(num_solves_, 1);
}

TEST_F(Strategies, DoglegTakesStepsThatAreNotFiniteAsSingular) {
  Make(TrustRegionStrategyKind::kDogleg);
  model_->answer[1] = std::nan("");
  EXPECT_EQ(Step().code, StatusCode::kSingular);
  EXPECT_EQ(num_solves_, 8);
}

TEST_F(Strategies, DoglegSolvesAnewOnlyAfterAcceptanceOrAnInvalidStep) {
  Make(TrustRegionStrategyKind::kDogleg);
  ASSERT_TRUE(Step().ok());
  strategy_->StepRejected();
  ASSERT_TRUE(Step().ok());
  EXPECT_EQ(num_solves_, 1);
  strategy_->StepIsInvalid();
  ASSERT_TRUE(Step().ok());
  EXPECT_EQ(num_solves_, 2);
  EXPECT_NEAR(model_->dampings[1][0] / model_->dampings[0][0], 10.0, 1e-9);
  strategy_->StepAccepted(0.5);
  ASSERT_TRUE(Step().ok());
  EXPECT_EQ(num_solves_, 3);
}

// A short Gauss–Newton step is taken whole; a smaller radius gives a step of exactly that length in
// the metric w.
TEST_F(Strategies, DoglegStepHasTheLengthOfTheRadius) {
  options_.initial_trust_region_radius = 1e4;
  Make(TrustRegionStrategyKind::kDogleg);
  model_->answer.assign(3, 0.0);
  for (std::size_t j = 0; j < 3; ++j) {
    // longer than the Cauchy step
    model_->answer[j] = -10.0 * model_->Gradient()[j] + (j == 0 ? 5.0 : 1.0);
  }
  ASSERT_TRUE(Step().ok());
  for (std::size_t j = 0; j < 3; ++j) {
    EXPECT_NEAR(step_[j], model_->answer[j], 1e-12);
  }
  for (int k = 0; k < 40; ++k) {
    strategy_->StepRejected();
    ASSERT_TRUE(Step().ok());
    double squared = 0.0;
    double gauss_newton = 0.0;
    for (std::size_t j = 0; j < 3; ++j) {
      const double w2 = model_->dampings[0][j] / 1e-8;
      squared += w2 * step_[j] * step_[j];
      gauss_newton += w2 * model_->answer[j] * model_->answer[j];
    }
    const double expected = std::min(strategy_->Radius(), std::sqrt(gauss_newton));
    EXPECT_NEAR(std::sqrt(squared), expected, 1e-9 * expected) << "radius " << strategy_->Radius();
  }
}

TEST_F(Strategies, DoglegRadius) {
  options_.initial_trust_region_radius = 8.0;
  options_.max_trust_region_radius = 8.0;
  Make(TrustRegionStrategyKind::kDogleg);
  strategy_->StepAccepted(0.5);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 8.0);
  strategy_->StepAccepted(0.2);
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 4.0);
  strategy_->StepRejected();
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 2.0);
  strategy_->StepIsInvalid();
  EXPECT_DOUBLE_EQ(strategy_->Radius(), 2.0);
  model_->answer = {100.0, -200.0, 300.0};
  ASSERT_TRUE(Step().ok());
  strategy_->StepAccepted(0.9);
  EXPECT_NEAR(strategy_->Radius(), 6.0,
              1e-9);  // three times the step's length, which was the radius
  strategy_->StepAccepted(0.9);
  EXPECT_NEAR(strategy_->Radius(), 6.0, 1e-9);
}

// The step is the lowest point of the model among all of its length in the plane of g̃ and the
// Gauss–Newton step.
TEST_F(Strategies, SubspaceDoglegIsTheMinimumOnTheCircle) {
  options_.initial_trust_region_radius = 1e-2;
  Make(TrustRegionStrategyKind::kSubspaceDogleg);
  model_->answer = {3.0, -2.0, 4.0};
  for (int shrink = 0; shrink < 6; ++shrink) {
    ASSERT_TRUE(Step().ok());
    const std::vector<double>& g = model_->Gradient();
    const auto model_at = [&](const std::vector<double>& delta) {
      double value = 0.5 * model_->Quadratic(delta.data());
      for (std::size_t j = 0; j < 3; ++j) {
        value += g[j] * delta[j];
      }
      return value;
    };
    std::vector<double> w(3);
    double squared = 0.0;
    for (std::size_t j = 0; j < 3; ++j) {
      w[j] = std::sqrt(model_->dampings[0][j] / 1e-8);
      squared += w[j] * w[j] * step_[j] * step_[j];
    }
    EXPECT_NEAR(std::sqrt(squared), strategy_->Radius(), 1e-6 * strategy_->Radius());
    double lowest = 0.0;
    for (int k = 0; k < 7200; ++k) {
      const double angle = 3.14159265358979323846 * k / 3600.0;
      std::vector<double> delta(3);
      double norm = 0.0;
      for (std::size_t j = 0; j < 3; ++j) {
        const double p = std::cos(angle) * g[j] / w[j] + std::sin(angle) * w[j] * model_->answer[j];
        norm += p * p;
        delta[j] = p / w[j];
      }
      for (double& entry : delta) {
        entry *= strategy_->Radius() / std::sqrt(norm);
      }
      lowest = std::min(lowest, model_at(delta));
    }
    EXPECT_LT(lowest, 0.0);
    EXPECT_LE(model_at(step_), lowest + 1e-9 * std::abs(lowest));
    EXPECT_GE(model_at(step_), lowest + 1e-3 * lowest) << "and it is of the circle";
    strategy_->StepRejected();
  }
  EXPECT_EQ(num_solves_, 1) << "a rejected step asks for nothing new";
}

TEST_F(Strategies, SubspaceDoglegOnALineAndOfNothing) {
  options_.initial_trust_region_radius = 1e-3;
  Make(TrustRegionStrategyKind::kSubspaceDogleg);
  const std::vector<double>& g = model_->Gradient();
  std::vector<double> w2(3);
  for (std::size_t j = 0; j < 3; ++j) {
    w2[j] = std::max(scale_[j] * scale_[j] * model_->Diagonal()[j], 1e-6) / (scale_[j] * scale_[j]);
    model_->answer[j] = -2.0 * g[j] / w2[j];
  }
  ASSERT_TRUE(Step().ok());
  for (std::size_t j = 0; j < 3; ++j) {
    EXPECT_NEAR(step_[j] / model_->answer[j], step_[0] / model_->answer[0], 1e-9)
        << "along the gradient";
  }
  EXPECT_GT(step_[0] / model_->answer[0], 0.0);
}

}  // namespace
}  // namespace inceres::internal
