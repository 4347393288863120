// What cannot be evaluated is named: the factor with its variables, or the manifold.
#include <array>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "support/core_pipeline.h"
#include "support/test_families.h"

namespace inceres::internal {
namespace {

using test::CorePipeline;
using test::FunctionFamily;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// 600 factors (three chunks) in one variable, f = x; `spoil` may change what factor i returns, and
// one may write nothing.
class FailingFactors : public testing::Test {
 protected:
  using Spoil = std::function<bool(int i, double* residuals, double** jacobians)>;

  void Build(Spoil spoil, int silent = -1) {
    graph_ = FactorGraph();
    const double one = 1.0;
    const VariableId x = graph_.AddVariable(&one, 1, Role::kFrame);
    const auto family = graph_.AddFamily(std::make_shared<FunctionFamily>(
        1, std::vector<FactorFamily::Slot>{{1, 1}},
        [=](int i, const double* const* parameters, double* residuals, double** jacobians) {
          if (i == silent) {
            return true;
          }
          residuals[0] = parameters[0][0];
          if (jacobians != nullptr && jacobians[0] != nullptr) {
            jacobians[0][0] = 1.0;
          }
          return spoil(i, residuals, jacobians);
        }));
    for (int i = 0; i < 600; ++i) {
      graph_.AddFactor(family, 0, {x});
    }
  }

  // `in_all`: and in evaluations without Jacobians.
  void ExpectFailure(const std::string& expected, bool in_all) {
    for (const JacobianStorage storage : {JacobianStorage::kBySlot, JacobianStorage::kInChunks}) {
      for (const int num_threads : {1, 4}) {
        CorePipeline core(graph_, true, num_threads, LandmarkIncidences::kQuadsPerChunk, storage);
        EXPECT_EQ(core.status.code, StatusCode::kEvaluationFailed);
        EXPECT_EQ(core.status.message.rfind(expected + "; at variable 0 = (", 0), 0U)
            << core.status.message;
        double cost = 0.0;
        const Status candidate = core.evaluator.EvaluateCandidateCost(&cost);
        EXPECT_EQ(candidate.message, in_all ? core.status.message : "");
      }
    }
  }

  FactorGraph graph_;
};

TEST_F(FailingFactors, FalseNamesTheFirstFactor) {
  Build([](int i, double*, double**) { return i != 300 && i != 550; });
  ExpectFailure("factor 300 of function (variables 0): the cost function returned false", true);
}

TEST_F(FailingFactors, ResidualsThatAreNotFiniteOrNotWritten) {
  const std::string expected =
      "factor 17 of function (variables 0): a residual is not finite or was not written: residual "
      "0 ";
  for (const double bad : {kNaN, HUGE_VAL, -HUGE_VAL}) {
    Build([bad](int i, double* residuals, double**) {
      residuals[0] = i == 17 ? bad : residuals[0];
      return true;
    });
    ExpectFailure(expected + "is " + std::to_string(bad), true);
  }
  Build([](int, double*, double**) { return true; }, /*silent=*/17);
  ExpectFailure(expected + "was not written", true);
}

TEST_F(FailingFactors, JacobiansThatAreNotFinite) {
  for (const double bad : {kNaN, HUGE_VAL, -HUGE_VAL}) {
    Build([bad](int i, double*, double** jacobians) {
      if (jacobians != nullptr && i == 599) {
        jacobians[0][0] = bad;
      }
      return true;
    });
    ExpectFailure(
        "factor 599 of function (variables 0): a Jacobian entry is not finite or was not written: "
        "entry (0, 0) of the Jacobian by variable 0 is " +
            std::to_string(bad),
        false);
  }
}

TEST_F(FailingFactors, LossesWithoutAnyLeastSquaresForm) {
  Build([](int i, double* residuals, double** jacobians) {
    residuals[0] *= i < 400 ? 2.0 : 1.0;
    if (jacobians != nullptr) {
      jacobians[0][0] *= i < 400 ? 2.0 : 1.0;
    }
    return true;
  });
  // At s = 1 the first derivative is zero, and the second one is not.
  const auto loss = test::LossOf([](double s) {
    return std::array{(s - 1.0) * (s - 1.0), 2.0 * (s - 1.0), 2.0};
  });
  for (int i = 200; i < 600; ++i) {
    graph_.SetLoss(0, i, loss);
  }
  ExpectFailure(
      "factor 400 of function (variables 0): its loss has a second derivative above zero and a "
      "first one that is not",
      false);
  // The cost alone is that of any other loss.
  CorePipeline core(graph_);
  double cost = 0.0;
  EXPECT_TRUE(core.evaluator.EvaluateCandidateCost(&cost).ok());
  EXPECT_EQ(cost, 0.5 * (200 * 4.0 + 200 * 9.0));
}

// x with a manifold whose PlusJacobian is what the test says.
class OddManifold final : public Manifold {
 public:
  OddManifold(bool defined, double entry) : defined_(defined), entry_(entry) {}
  int AmbientSize() const override { return 1; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* out) const override {
    out[0] = x[0] + delta[0];
    return delta[0] < 10.0;
  }
  bool PlusJacobian(const double*, double* J) const override {
    if (!std::isnan(entry_)) {
      J[0] = entry_;
    }
    return defined_;
  }

 private:
  bool defined_;
  double entry_;  // NaN: not written
};

Status EvaluateOn(std::shared_ptr<const Manifold> manifold) {
  FactorGraph graph;
  auto family = std::make_shared<test::SmoothFamily>(1, std::vector<FactorFamily::Slot>{{1, 1}});
  test::Random random(1);
  const double one = 1.0;
  const VariableId x = graph.AddVariable(&one, 1, Role::kFrame, std::move(manifold));
  graph.AddFactor(graph.AddFamily(family), family->MakeMeasurement(&random), {x});
  CorePipeline core(graph);
  double cost = 0.0;
  EXPECT_EQ(core.evaluator.EvaluateCandidateCost(&cost).ok(), core.status.ok())
      << "cost-only evaluations ask as well";
  const double far = 100.0;
  EXPECT_FALSE(core.evaluator.points().MoveCandidate(&far));
  return core.status;
}

TEST(FailingManifolds, PlusJacobianFalseInfiniteOrNotWritten) {
  EXPECT_TRUE(EvaluateOn(std::make_shared<OddManifold>(true, 1.0)).ok());
  EXPECT_EQ(EvaluateOn(std::make_shared<OddManifold>(false, 1.0)).message,
            "PlusJacobian of the manifold of variable 0 returned false");
  for (const double entry : {HUGE_VAL, kNaN}) {
    EXPECT_EQ(EvaluateOn(std::make_shared<OddManifold>(true, entry)).message,
              "PlusJacobian of the manifold of variable 0 has an entry that is not finite or was "
              "not written");
  }
}

}  // namespace
}  // namespace inceres::internal
