// Blocks of Jacobians that are all zeros, left out of H: the same steps, whatever moves between
// linearizations.
#include <algorithm>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/ambient_family.h"
#include "inceres/problem/losses.h"
#include "inceres/solver/solver.h"
#include "support/random_graph.h"
#include "trust_region/same_bits.h"
#include "trust_region/solver_way.h"

namespace inceres {
namespace {

using test::ExpectSameBits;

// The point of a closed quadratic B-spline at t, less an observation. Slots: t, then all control
// points, of which three count.
class CurveFamily final : public AmbientFamily<CurveFamily> {
 public:
  explicit CurveFamily(int num_control_points) : AmbientFamily(2, Slots(num_control_points)) {}

  void Add(double x, double y) { observations_.push_back({x, y}); }
  int size() const override { return static_cast<int>(observations_.size()); }
  const char* Name() const override { return "curve"; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const int n = num_slots() - 1;
    const double t = parameters[0][0] - n * std::floor(parameters[0][0] / n);
    const int first = std::min(static_cast<int>(t), n - 1);
    const double u = t - first;
    const double weights[3] = {0.5 * (1.0 - u) * (1.0 - u), 0.5 + u * (1.0 - u), 0.5 * u * u};
    const double slopes[3] = {u - 1.0, 1.0 - 2.0 * u, u};
    for (int k = 1; jacobians != nullptr && k <= n; ++k) {
      if (jacobians[k] != nullptr) {
        std::fill_n(jacobians[k], 4, 0.0);
      }
    }
    for (int d = 0; d < 2; ++d) {
      double tangent = 0.0;
      residuals[d] = -(d == 0 ? observations_[static_cast<std::size_t>(i)].x
                              : observations_[static_cast<std::size_t>(i)].y);
      for (int k = 0; k < 3; ++k) {
        const int slot = 1 + (first + k) % n;
        residuals[d] += weights[k] * parameters[slot][d];
        tangent += slopes[k] * parameters[slot][d];
        if (jacobians != nullptr && jacobians[slot] != nullptr) {
          jacobians[slot][3 * d] = weights[k];
        }
      }
      if (jacobians != nullptr && jacobians[0] != nullptr) {
        jacobians[0][d] = tangent;
      }
    }
    return true;
  }

 private:
  struct Observation {
    double x, y;
  };
  static std::vector<Slot> Slots(int num_control_points) {
    std::vector<Slot> slots(static_cast<std::size_t>(num_control_points) + 1, Slot{2, 2});
    slots[0] = {1, 1};
    return slots;
  }
  std::vector<Observation> observations_;
};

// Neighbors are near each other.
class SpringFamily final : public AmbientFamily<SpringFamily> {
 public:
  explicit SpringFamily(int num_springs)
      : AmbientFamily(2, {{2, 2}, {2, 2}}), num_springs_(num_springs) {}
  int size() const override { return num_springs_; }
  const char* Name() const override { return "spring"; }
  bool EvaluateOne(int, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    for (int d = 0; d < 2; ++d) {
      residuals[d] = 0.05 * (parameters[0][d] - parameters[1][d]);
    }
    for (int s = 0; jacobians != nullptr && s < 2; ++s) {
      if (jacobians[s] != nullptr) {
        std::fill_n(jacobians[s], 4, 0.0);
        jacobians[s][0] = jacobians[s][3] = s == 0 ? 0.05 : -0.05;
      }
    }
    return true;
  }

 private:
  int num_springs_;
};

constexpr int kControlPoints = 60;
constexpr int kObservations = 250;

FactorGraph MakeCurve(unsigned seed, const std::shared_ptr<const Loss>& loss = nullptr,
                      bool some_constant = false) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  FactorGraph graph;
  std::vector<VariableId> slots = {0};
  for (int k = 0; k < kControlPoints; ++k) {
    const double angle = 2.0 * M_PI * k / kControlPoints;
    const double point[2] = {3.0 * std::cos(angle), 3.0 * std::sin(angle)};
    slots.push_back(graph.AddVariable(point, 2, Role::kFrame));
    if (some_constant && k % 7 == 0) {
      graph.SetConstant(slots.back(), true);
    }
  }
  auto curve = std::make_shared<CurveFamily>(kControlPoints);
  const FamilyId curve_id = graph.AddFamily(curve);
  const FamilyId spring_id = graph.AddFamily(std::make_shared<SpringFamily>(kControlPoints));
  for (int i = 0; i < kObservations; ++i) {
    const double angle = 2.0 * M_PI * i / kObservations;
    const double t = kControlPoints * (angle / (2.0 * M_PI)) + 0.6 * normal(random);
    slots[0] = graph.AddVariable(&t, 1, Role::kFrame);
    curve->Add(5.0 * std::cos(angle) + 0.02 * normal(random),
               2.0 * std::sin(angle) + 0.02 * normal(random));
    graph.Connect(curve_id, slots.data(), loss);
  }
  for (int k = 0; k < kControlPoints; ++k) {
    const VariableId pair[2] = {slots[static_cast<std::size_t>(k) + 1],
                                slots[static_cast<std::size_t>((k + 1) % kControlPoints) + 1]};
    graph.Connect(spring_id, pair);
  }
  return graph;
}

// Of each observation, the first control point that counts.
std::vector<int> Segments(const FactorGraph& graph) {
  std::vector<int> segments;
  for (VariableId id = kControlPoints; id < graph.num_variables(); ++id) {
    segments.push_back(static_cast<int>(std::floor(graph.Values(id)[0])));
  }
  return segments;
}

SolverOptions Dynamic() {
  SolverOptions options;
  options.dynamic_sparsity = true;
  options.max_num_iterations = 15;
  options.function_tolerance = 1e-10;
  return options;
}

SolverOptions Static() {
  SolverOptions options = Dynamic();
  options.dynamic_sparsity = false;
  return options;
}

void ExpectSameTrace(const Summary& a, const Summary& b, double tolerance) {
  EXPECT_EQ(a.termination, b.termination);
  ASSERT_EQ(a.iterations.size(), b.iterations.size());
  for (std::size_t k = 0; k < a.iterations.size(); ++k) {
    EXPECT_EQ(a.iterations[k].step_is_successful, b.iterations[k].step_is_successful) << k;
    EXPECT_NEAR(a.iterations[k].cost, b.iterations[k].cost, tolerance * b.iterations[k].cost) << k;
    EXPECT_NEAR(a.iterations[k].gradient_norm, b.iterations[k].gradient_norm,
                tolerance * b.iterations[0].gradient_norm)
        << k;
  }
}

TEST(DynamicSparsity, TraceIsThatOfTheWholeJacobian) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    for (const auto strategy :
         {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kDogleg}) {
      SolverOptions dynamic = Dynamic();
      SolverOptions whole = Static();
      dynamic.strategy = whole.strategy = strategy;
      // points that move from segment to segment make rounding errors grow with the steps: to 5e-8
      dynamic.max_num_iterations = whole.max_num_iterations = 8;
      FactorGraph a = MakeCurve(seed);
      FactorGraph b = MakeCurve(seed);
      const std::vector<int> before = Segments(a);
      const Summary summary = Solve(dynamic, &a);
      ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
      ExpectSameTrace(summary, Solve(whole, &b), 1e-7);
      EXPECT_LT(summary.final_cost, 0.1 * summary.initial_cost);
      EXPECT_NE(Segments(a), before) << "no zeros have moved";
      EXPECT_EQ(summary.reduced_solver.substr(0, 15), "sparse Cholesky");
    }
  }
}

TEST(DynamicSparsity, SoItIsWithLossesAndConstants) {
  for (const unsigned seed : {4U, 5U}) {
    const auto loss = std::make_shared<CauchyLoss>(0.3);
    FactorGraph a = MakeCurve(seed, loss, /*some_constant=*/true);
    FactorGraph b = MakeCurve(seed, loss, /*some_constant=*/true);
    const std::vector<int> before = Segments(a);
    SolverOptions dynamic = Dynamic();
    SolverOptions whole = Static();
    // a redescending loss makes rounding errors grow from step to step
    dynamic.max_num_iterations = whole.max_num_iterations = 8;
    ExpectSameTrace(Solve(dynamic, &a), Solve(whole, &b), 1e-7);
    EXPECT_NE(Segments(a), before);
  }
}

TEST(DynamicSparsity, SameBitsForAnyNumberOfThreads) {
  FactorGraph one = MakeCurve(6, std::make_shared<HuberLoss>(0.5));
  const Summary expected = Solve(Dynamic(), &one);
  for (const int num_threads : {2, 4}) {
    SolverOptions options = Dynamic();
    options.num_threads = num_threads;
    FactorGraph graph = MakeCurve(6, std::make_shared<HuberLoss>(0.5));
    ExpectSameBits(Solve(options, &graph), expected);
    EXPECT_EQ(graph.state(), one.state());
  }
}

// A structure met before: what an earlier solve left in the pattern is not used again.
TEST(DynamicSparsity, ASolverThatIsUsedAgainHasTheBitsOfANewOne) {
  Solver solver;
  for (const unsigned seed : {7U, 8U, 7U}) {
    FactorGraph ours = MakeCurve(seed);
    FactorGraph fresh = MakeCurve(seed);
    ExpectSameBits(solver.Solve(Dynamic(), &ours), Solve(Dynamic(), &fresh));
    EXPECT_EQ(ours.state(), fresh.state());
    EXPECT_TRUE(solver.IsReadyFor(Dynamic(), fresh));
    EXPECT_FALSE(solver.IsReadyFor(Static(), fresh));
  }
}

TEST(DynamicSparsity, LandmarksAreFrames) {
  const auto ours = test::MakeBundle(test::MixedBundle(60));
  const auto plain = test::MakeBundle(test::MixedBundle(60));
  SolverOptions options;
  options.max_num_iterations = 6;
  options.linear_model = LinearModelKind::kPlain;
  const Summary expected = Solve(options, &plain->graph());
  options.linear_model = LinearModelKind::kAutomatic;
  options.dynamic_sparsity = true;
  const Summary summary = Solve(options, &ours->graph());
  ExpectSameTrace(summary, expected, 1e-8);
  EXPECT_EQ(summary.work.num_landmarks, 0);
}

TEST(DynamicSparsity, NamesTheModelsItDoesNotGoWith) {
  for (const auto model : {LinearModelKind::kSchur, LinearModelKind::kDenseQr}) {
    SolverOptions options = Dynamic();
    options.linear_model = model;
    EXPECT_EQ(options.Validate().code, StatusCode::kInvalidArgument);
    EXPECT_NE(options.Validate().message.find("SolverOptions::dynamic_sparsity"),
              std::string::npos);
  }
}

}  // namespace
}  // namespace inceres
