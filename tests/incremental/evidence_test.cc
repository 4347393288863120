// What counts as evidence of a minimum, and what is left of it after failures: steps that could not
// be evaluated, losses without a weight, options that have become stricter, code that throws.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/losses.h"
#include "inceres/solver/incremental_solver.h"
#include "incremental/incremental_function.h"
#include "incremental/step_control.h"
#include "support/test_families.h"

namespace inceres {
namespace {

using test::FunctionFamily;
using test::IncrementalFunction;

IncrementalOptions WithoutBatch(double function_tolerance) {
  IncrementalOptions options;
  options.batch_share = 1.0;
  options.function_tolerance = function_tolerance;
  return options;
}

// The step to 1 gains 200 times its promise, so that nothing that the model says there is borne
// out; it promises less than half of the tolerance to go on, and that cannot be evaluated.
TEST(Evidence, AStepThatCannotBeEvaluatedProvesNothing) {
  const auto function = [](int, const double* const* p, double* f, double** J) {
    const double x = p[0][0];
    if (x > 1.000001) {
      return false;
    }
    const double t = std::clamp(x, 0.0, 1.0);
    f[0] = 0.1 * (x - 1.0);
    f[1] = 10.0 - 0.1 * t * t * (3.0 - 2.0 * t);
    f[2] = -0.054 * t * t * (3.0 - 2.0 * t);
    if (x > 0.99) {  // the slope that f[0] has there
      f[0] = 0.1 * (x - 1.0) - 0.054;
      f[2] = 0.0;
    }
    if (J != nullptr && J[0] != nullptr) {
      J[0][0] = 0.1;
      J[0][1] = -0.6 * t * (1.0 - t);
      J[0][2] = x > 0.99 ? 0.0 : -0.324 * t * (1.0 - t);
    }
    return true;
  };
  IncrementalOptions options = WithoutBatch(1e-4);
  options.initial_damping = options.min_damping;
  IncrementalFunction one(options, function, 3, 0.0, std::make_shared<HuberLoss>(1e6));
  ASSERT_TRUE(one.applied);
  const UpdateSummary summary = one.solver.Update();
  EXPECT_NEAR(*one.solver.Values(one.x), 1.0, 1e-3);
  EXPECT_EQ(summary.termination, Termination::kNoConvergence) << summary.FullReport();
  EXPECT_FALSE(summary.failed_step.empty());
}

// At 0 the slope is a twentieth of what the tolerance asks for, and the step that it asks for gains
// 200 times what the model sees.
FunctionFamily::Function Hump() {
  return [](int, const double* const* p, double* f, double** J) {
    const double t = std::clamp(p[0][0], 0.0, 1.0);
    f[0] = 0.1 * (p[0][0] - 1.0);
    f[1] = 10.0 - 0.1 * t * t * (3.0 - 2.0 * t);
    if (J != nullptr && J[0] != nullptr) {
      J[0][0] = 0.1;
      J[0][1] = -0.6 * t * (1.0 - t);
    }
    return true;
  };
}

// No step has led to the top of the hump, so that one is tried.
class TopOfAHump : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(one_.applied); }
  void ExpectMinimum(const GraphEdit& edit) {
    ASSERT_TRUE(one_.solver.Apply(edit).ok());
    const UpdateSummary summary = one_.solver.Update();
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    EXPECT_NEAR(*one_.solver.Values(one_.x), 1.0, 0.1);
  }

  IncrementalFunction one_{WithoutBatch(2e-3), Hump(), 2, 1.0, std::make_shared<HuberLoss>(1e6)};
};

TEST_F(TopOfAHump, WhereAValueWasWritten) {
  ASSERT_EQ(one_.solver.Update().termination, Termination::kConvergence);
  const double zero = 0.0;
  GraphEdit edit(one_.solver.graph());
  edit.SetValues(one_.x, &zero);
  ExpectMinimum(edit);
}

TEST_F(TopOfAHump, WhereWhatHeldTheVariableThereIsGone) {
  const auto at_zero =
      one_.solver.AddFamily(test::ScalarFamily([](double x) { return 100.0 * x; }, 100.0));
  GraphEdit edit(one_.solver.graph());
  const FactorId held = edit.AddFactor(at_zero, 0, {one_.x});
  ASSERT_TRUE(one_.solver.Apply(edit).ok());
  ASSERT_EQ(one_.solver.Update().termination, Termination::kConvergence);
  ASSERT_NEAR(*one_.solver.Values(one_.x), 0.0, 1e-3);
  edit.Restart();
  edit.RemoveFactor(held);
  ExpectMinimum(edit);
}

FunctionFamily::Function Identity() {
  return test::ScalarFunction([](double x) { return x; }, 1.0);
}

TEST(Evidence, ALossWithoutAWeightIsNamedAndLeavesNothingBehind) {
  // ρ(s) = 2 √s: no weight at s = 0.
  const auto cone = test::LossOf([](double s) {
    const double root = std::sqrt(s);
    return std::array{2.0 * root, 1.0 / root, -0.5 / (s * root)};
  });
  IncrementalFunction one(WithoutBatch(1e-8), Identity(), 1, 0.0, cone);
  ASSERT_TRUE(one.applied);
  GraphEdit edit(one.solver.graph());
  const auto measured =
      one.solver.AddFamily(test::ScalarFamily([](double x) { return x - 3.0; }, 1.0));
  edit.Restart();
  edit.AddFactor(measured, 0, {one.x});
  ASSERT_TRUE(one.solver.Apply(edit).ok());
  const UpdateSummary refused = one.solver.Update();
  EXPECT_EQ(refused.termination, Termination::kFailure);
  EXPECT_NE(refused.message.find("first derivative"), std::string::npos) << refused.message;
  EXPECT_NE(refused.message.find("factor 0"), std::string::npos) << refused.message;

  edit.Restart();
  edit.SetLoss(one.factor, nullptr);
  ASSERT_TRUE(one.solver.Apply(edit).ok());
  const UpdateSummary summary = one.solver.Update();
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_NEAR(*one.solver.Values(one.x), 1.5, 1e-6);
}

// Where the step would lead there is none.
TEST(Evidence, AStepToWhereALossHasNoWeightIsRefused) {
  const auto hole = test::LossOf([](double s) {
    return std::array{s, s < 0.25 ? std::numeric_limits<double>::quiet_NaN() : 1.0, 0.0};
  });
  IncrementalFunction one(WithoutBatch(1e-8), Identity(), 1, 4.0, hole);
  ASSERT_TRUE(one.applied);
  const UpdateSummary summary = one.solver.Update();
  EXPECT_NE(summary.termination, Termination::kFailure) << summary.message;
  EXPECT_NE(summary.failed_step.find("weight"), std::string::npos) << summary.failed_step;
  EXPECT_TRUE(std::isfinite(*one.solver.Values(one.x)));
  EXPECT_LE(one.solver.cost(), 8.0);
  EXPECT_GE(one.solver.cost(), 0.125);
}

// A curved valley, along which there are fifty tolerances to gain: a step without damping leaves
// it, one with the damping at first promises next to nothing, and one in between gains much. The
// batch solver begins, and where it ends is no minimum.
TEST(Evidence, WhatDampingHidesBelowARefusedStepIsNoMinimum) {
  constexpr double kWeight = 3e-4;
  constexpr double kLength = 3e-3;
  IncrementalOptions options;
  options.max_num_iterations = 200;
  const double tolerance = 0.5 * kWeight * kWeight * kLength * kLength / 50.0;
  const double least = tolerance / options.function_tolerance;
  IncrementalSolver solver(options);
  const auto family = solver.AddFamily(
      test::JetFamily<4, 2, 1>([=](const auto* valley, const auto* other, auto* f) {
        f[0] = valley[1] - valley[0] * valley[0];
        f[1] = kWeight * (valley[0] - 1.0 - kLength);
        f[2] = other[0];
        f[3] = std::sqrt(2.0 * least) + 0.0 * other[0];
      }));
  const double valley[2] = {1.0, 1.0}, other = std::sqrt(10.0 * tolerance);
  GraphEdit edit(solver.graph());
  const VariableId id = edit.AddVariable(valley, 2, Role::kFrame);
  edit.AddFactor(family, 0, {id, edit.AddVariable(&other, 1, Role::kFrame)});
  ASSERT_TRUE(solver.Apply(edit).ok());
  const UpdateSummary summary = solver.Update();
  ASSERT_GT(summary.num_batch_iterations, 0);
  EXPECT_LT(summary.final_cost - least, tolerance) << summary.FullReport();
}

// What was converged by looser options has not by these.
TEST(Evidence, StricterOptionsAskAgain) {
  IncrementalOptions loose = WithoutBatch(1e-6);
  IncrementalFunction one(loose, Identity());
  ASSERT_TRUE(one.applied);
  ASSERT_EQ(one.solver.Update().termination, Termination::kConvergence);
  const auto says_nothing_changed = [&one] {
    return one.solver.Update().message.find("Nothing has changed") != std::string::npos;
  };
  one.solver.SetOptions(loose);
  EXPECT_TRUE(says_nothing_changed());
  IncrementalOptions options = loose;
  options.function_tolerance = 1e-3;
  one.solver.SetOptions(options);
  EXPECT_TRUE(says_nothing_changed()) << "a looser tolerance";
  one.solver.SetOptions(loose);
  EXPECT_FALSE(says_nothing_changed());
  options = loose;
  options.claim_damping_share = 0.001;
  one.solver.SetOptions(options);
  EXPECT_FALSE(says_nothing_changed());
  options.max_landmark_refinements = 2;
  one.solver.SetOptions(options);
  EXPECT_FALSE(says_nothing_changed());
  options.min_damping = 1e-9;
  one.solver.SetOptions(options);
  EXPECT_FALSE(says_nothing_changed());
}

// At the floor little was left and a step was refused; since then others have gained much more than
// that, so it was of another point.
TEST(Evidence, WhatWasLeftAtTheFloorIsOfThatPointOnly) {
  const internal::Tuning tuning;
  IncrementalOptions options;
  internal::StepControl control(tuning, options, options.min_damping);
  control.Sees(0.8);
  control.Refuse(0.8, /*blindly=*/false);
  ASSERT_TRUE(control.IsDampedHard());
  ASSERT_TRUE(control.RelaxOnce(1.0));
  control.Sees(0.8);
  control.Refuse(0.8, /*blindly=*/false);
  control.Accept(0.3, 0.4, /*shortened=*/false);
  EXPECT_FALSE(control.RelaxOnce(1.0)) << "once, while next to nothing is gained";
  control.Accept(0.3, 0.7, /*shortened=*/false);
  EXPECT_TRUE(control.RelaxOnce(1.0));
  EXPECT_FALSE(control.IsDampedHard());
}

// Two variables and a factor each, one between them; the family throws when it is told to, with or
// without Jacobians. Values that the last accepted step has led to stay, and the next Update ends
// where one without an exception does.
TEST(Evidence, WhatAFactorThrowsLeavesASolverThatGoesOn) {
  for (const bool memory : {false, true}) {
    for (const bool with_jacobians : {false, true}) {
      for (int countdown = 1; countdown < 12; ++countdown) {
        int left = -1;
        IncrementalOptions options = WithoutBatch(1e-12);
        IncrementalSolver solver(options);
        const auto family = solver.AddFamily(std::make_shared<FunctionFamily>(
            2, std::vector<FactorFamily::Slot>{{1, 1}, {1, 1}},
            [&](int i, const double* const* p, double* f, double** J) {
              if ((J != nullptr) == with_jacobians && left > 0 && --left == 0) {
                if (memory) {
                  throw std::bad_alloc();
                }
                throw std::runtime_error("not today");
              }
              const double x = p[0][0], y = p[1][0];
              f[0] = x + 0.2 * std::sin(y) - i;
              f[1] = 0.5 * x - y + 1.0;
              if (J != nullptr && J[0] != nullptr) {
                J[0][0] = 1.0;
                J[0][1] = 0.5;
              }
              if (J != nullptr && J[1] != nullptr) {
                J[1][0] = 0.2 * std::cos(y);
                J[1][1] = -1.0;
              }
              return true;
            }));
        GraphEdit edit(solver.graph());
        const double zero = 0.3;
        std::vector<VariableId> ids;
        for (int k = 0; k < 4; ++k) {
          ids.push_back(edit.AddVariable(&zero, 1, Role::kFrame));
        }
        for (int k = 0; k < 3; ++k) {
          edit.AddFactor(family, k, {ids[k], ids[k + 1]});
        }
        ASSERT_TRUE(solver.Apply(edit).ok());
        ASSERT_EQ(solver.Update().termination, Termination::kConvergence);
        const double expected = solver.cost();
        // Far from there again.
        const auto set_back = [&] {
          edit.Restart();
          for (const VariableId id : ids) {
            const double far = 2.0 + 0.1 * id;
            edit.SetValues(id, &far);
          }
          ASSERT_TRUE(solver.Apply(edit).ok());
        };
        set_back();
        left = countdown;
        if (memory) {
          UpdateSummary summary = solver.Update();
          EXPECT_TRUE(left > 0 || summary.termination == Termination::kFailure);
          EXPECT_TRUE(left > 0 || summary.message == "Out of memory.") << summary.message;
        } else {
          try {
            solver.Update();
            EXPECT_GT(left, 0);
          } catch (const std::runtime_error&) {
          }
        }
        left = -1;
        EXPECT_TRUE(std::isfinite(solver.cost()));
        const UpdateSummary again = solver.Update();
        EXPECT_EQ(again.termination, Termination::kConvergence) << again.message;
        double cost = 0.0;
        for (int k = 0; k < 3; ++k) {
          const double* values[2] = {solver.Values(ids[k]), solver.Values(ids[k + 1])};
          double f[2];
          ASSERT_TRUE(family->EvaluateOne(k, values, f, nullptr));
          cost += 0.5 * (f[0] * f[0] + f[1] * f[1]);
        }
        EXPECT_NEAR(solver.cost(), cost, 1e-12 * std::max(1.0, cost));
        EXPECT_LE(solver.cost(), expected + 1e-9) << countdown << " " << with_jacobians;
      }
    }
  }
}

}  // namespace
}  // namespace inceres
