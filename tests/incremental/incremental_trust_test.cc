// What an Update says can be relied on: after cost functions that refused, where the cost is next
// to zero, and where it is not finite.

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/solver/incremental_solver.h"
#include "incremental/incremental_function.h"
#include "support/random_values.h"
#include "support/test_families.h"
#include "support/values_held.h"

namespace inceres {
namespace {

using test::FunctionFamily;
using test::IncrementalFunction;
using test::Random;

constexpr int kCameras = 6;
constexpr int kPoints = 20;

struct Pixel {
  double xy[2] = {0.0, 0.0};
};

// weight · (x − origin).
template <int kSize>
std::shared_ptr<FunctionFamily> WeighedPrior(double weight, const double* origin) {
  std::array<double, kSize> o;
  std::copy_n(origin, kSize, o.begin());
  return test::JetFamily<kSize, kSize>([weight, o](const auto* x, auto* f) {
    for (std::size_t k = 0; k < kSize; ++k) {
      f[k] = weight * (x[k] - o[k]);
    }
  });
}

// What a solver that remembers nothing comes down to from where this one is.
double Least(const IncrementalSolver& solver) {
  FactorGraph copy = test::AtValuesHeld(solver);
  SolverOptions options;
  options.function_tolerance = 1e-12;
  return Solve(options, &copy).final_cost;
}

// Cameras in a row that do not turn, with priors, see points some 5 in front of them. One point may
// be forbidden to come nearer than a depth: its cost function then refuses.
struct Row {
  explicit Row(unsigned seed) : random(seed), pixels(kCameras * kPoints) {
    view_family = solver.AddFamily(
        test::JetFamily<2, 3, 3>([this](int i, const auto* camera, const auto* point, auto* f) {
          const auto depth = point[2] - camera[2];
          if (i % kPoints == 0 && depth < nearest) {
            return false;
          }
          for (int k = 0; k < 2; ++k) {
            f[k] = (point[k] - camera[k]) / depth - pixels[static_cast<std::size_t>(i)].xy[k];
          }
          return true;
        }));
    const auto priors =
        solver.AddFamily(test::JetFamily<3, 3>([](int i, const auto* camera, auto* f) {
          for (int k = 0; k < 3; ++k) {
            f[k] = 10.0 * (camera[k] - (k == 0 ? 0.5 * i : 0.0));
          }
        }));
    GraphEdit edit(solver.graph());
    for (int c = 0; c < kCameras; ++c) {
      const double camera[3] = {0.5 * c, 0.0, 0.0};
      cameras.push_back(edit.AddVariable(camera, 3, Role::kFrame));
      edit.AddFactor(priors, c, {cameras.back()});
    }
    for (int l = 0; l < kPoints; ++l) {
      const double truth[3] = {random.Gaussian() + 1.5, random.Gaussian(), 5.0 + random.Gaussian()};
      const double start[3] = {truth[0] + 0.1 * random.Gaussian(),
                               truth[1] + 0.1 * random.Gaussian(),
                               truth[2] + 0.3 * random.Gaussian()};
      points.push_back(edit.AddVariable(start, 3, Role::kLandmark));
      for (int c = 0; c < kCameras; ++c) {
        double* xy = pixels[Index(c, l)].xy;
        xy[0] = (truth[0] - 0.5 * c) / truth[2] + 0.003 * random.Gaussian();
        xy[1] = truth[1] / truth[2] + 0.003 * random.Gaussian();
      }
    }
    for (int c = 0; c < kCameras; ++c) {
      for (int l = 0; l < kPoints; ++l) {
        views_of.push_back(edit.AddFactor(view_family, 0, {cameras[c], points[l]}));
      }
    }
    EXPECT_TRUE(solver.Apply(edit).ok());
  }

  static std::size_t Index(int camera, int point) {
    return static_cast<std::size_t>(camera) * kPoints + point;
  }

  // Tells the solver that these measurements were changed where they stand.
  void Revised(const std::vector<FactorId>& factors) {
    GraphEdit edit(solver.graph());
    for (const FactorId& factor : factors) {
      edit.SetMeasurement(factor, view_family, 0);
    }
    ASSERT_TRUE(solver.Apply(edit).ok());
  }

  // What a solver that remembers nothing still gains from here, relative.
  double Excess(double cost) const { return (cost - Least(solver)) / cost; }

  Random random;
  std::vector<Pixel> pixels;
  double nearest = 0.0;
  IncrementalSolver solver{IncrementalOptions()};
  FamilyHandle<FunctionFamily> view_family;
  std::vector<VariableId> cameras;
  std::vector<VariableId> points;
  std::vector<FactorId> views_of;
};

TEST(IncrementalTrust, RefusalsOfOneUpdateDoNotHoldTheNextOnesBack) {
  int refused = 0;
  for (unsigned seed = 0; seed < 20; ++seed) {
    Row row(seed);
    row.solver.Update();
    // The point's images move apart, so that it should come nearer, and it may not.
    for (int c = 0; c < kCameras; ++c) {
      for (int l = 0; l < kPoints; ++l) {
        for (double& entry : row.pixels[Row::Index(c, l)].xy) {
          entry *= l == 0 ? 1.15 : 1.0 + 0.1 * (l % 5 - 2);
        }
      }
    }
    row.nearest =
        0.99 * (row.solver.Values(row.points[0])[2] - row.solver.Values(row.cameras[0])[2]);
    row.Revised(row.views_of);
    const UpdateSummary sick = row.solver.Update();
    refused += sick.num_unsuccessful_steps;
    row.nearest = 0.0;
    for (int k = 1; k < 5; ++k) {
      row.pixels[Row::Index(1, k)].xy[0] += 0.002;
      row.Revised({row.views_of[Row::Index(1, k)]});
      const UpdateSummary healthy = row.solver.Update();
      EXPECT_EQ(healthy.termination, Termination::kConvergence) << healthy.message;
      EXPECT_LT(row.Excess(healthy.final_cost), 1e-6) << "seed " << seed << ", update " << k;
    }
  }
  EXPECT_GT(refused, 100) << "the cost function is to have refused steps";
}

// A chain of poses without a loop, whose first pose is constant or held by a prior of this weight:
// its minimum is zero but for rounding.
void GrowsWithoutALoop(double weight) {
  std::vector<double> steps;
  IncrementalSolver solver{IncrementalOptions()};
  const auto family = solver.AddFamily(
      test::JetFamily<3, 3, 3>([&](int i, const auto* from, const auto* to, auto* f) {
        using std::cos, std::sin;
        const auto c = cos(from[2]);
        const auto s = sin(from[2]);
        const auto dx = to[0] - from[0];
        const auto dy = to[1] - from[1];
        f[0] = 20.0 * (c * dx + s * dy - 1.0);
        f[1] = 20.0 * (-s * dx + c * dy);
        f[2] = 50.0 * (to[2] - from[2] - steps[static_cast<std::size_t>(i)]);
      }));
  Random random(3);
  double pose[3] = {100.0, -40.0, 0.3};
  const auto priors = solver.AddFamily(WeighedPrior<3>(weight, pose));
  GraphEdit edit(solver.graph());
  VariableId last = edit.AddVariable(pose, 3, Role::kFrame);
  if (weight > 0.0) {
    edit.AddFactor(priors, 0, {last});
  } else {
    edit.SetConstant(last, true);
  }
  int num_iterations = 0;
  for (int n = 0; n < 60; ++n) {
    steps.push_back(0.2 * random.Unit());
    pose[0] += std::cos(pose[2]);
    pose[1] += std::sin(pose[2]);
    pose[2] += steps.back();
    const VariableId next = edit.AddVariable(pose, 3, Role::kFrame);
    edit.AddFactor(family, n, {last, next});
    last = next;
    ASSERT_TRUE(solver.Apply(edit).ok());
    edit.Restart();
    const UpdateSummary summary = solver.Update();
    ASSERT_EQ(summary.termination, Termination::kConvergence) << n << ": " << summary.message;
    EXPECT_EQ(summary.num_unsuccessful_steps, 0) << n;
    num_iterations += summary.num_iterations;
  }
  EXPECT_LE(num_iterations, 2 * 60);
}

TEST(IncrementalTrust, CostNextToZeroIsConvergence) {
  for (const double weight : {0.0, 1.0, 1e7, 1e15}) {
    SCOPED_TRACE(weight);
    GrowsWithoutALoop(weight);
  }
}

// Positions in a row, each measured from the one before. The first has a prior of a weight that
// makes one last place of its value more than all of the cost, and is where the prior wants it; a
// few of the later ones are measured anew, from it, and disagree.
TEST(IncrementalTrust, RoundingOfAHeavyPriorIsNoToleranceForTheRest) {
  constexpr int kPositions = 12;
  for (const double weight : {1.0, 1e14, 1e15, 1e16}) {
    IncrementalOptions options;
    options.batch_share = 2.0;
    IncrementalSolver solver(options);
    const double origin = 0.1;
    const auto priors = solver.AddFamily(WeighedPrior<1>(weight, &origin));
    double measured[kPositions + 1];  // by the places of the factors
    const auto steps = solver.AddFamily(test::ScalarFamily(
        [&measured](int i, double a, double b) { return b - a - measured[i]; }, -1.0, 1.0));
    GraphEdit edit(solver.graph());
    std::vector<VariableId> positions;
    for (int k = 0; k < kPositions; ++k) {
      const double start = origin + k;
      positions.push_back(edit.AddVariable(&start, 1, Role::kFrame));
      measured[k] = 1.0;
      if (k > 0) {
        edit.AddFactor(steps, 0, {positions[static_cast<std::size_t>(k) - 1], positions.back()});
      }
    }
    edit.AddFactor(priors, 0, {positions[0]});
    ASSERT_TRUE(solver.Apply(edit).ok());
    solver.Update();
    // d apart over n steps of weight one: the cost is ½ d² / (n + 1), in all of the row together.
    for (int k = 0; k < 2; ++k) {
      edit.Restart();
      const int last = kPositions - 1 - 5 * k;
      measured[kPositions - 1 + k] = last + (k == 0 ? 0.3 : -0.2);
      edit.AddFactor(steps, 0, {positions[0], positions[static_cast<std::size_t>(last)]});
      ASSERT_TRUE(solver.Apply(edit).ok());
      const UpdateSummary summary = solver.Update();
      EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      EXPECT_LE(summary.num_iterations, 4);
      EXPECT_EQ(summary.num_unsuccessful_steps, 0);
      const double least = Least(solver);
      EXPECT_LE(summary.final_cost - least, 1e-6 * least) << "weight " << weight << ", edge " << k;
    }
  }
}

TEST(IncrementalTrust, WhatACostFunctionRefusesToEvaluateProvesNoMinimum) {
  IncrementalOptions options;
  options.batch_share = 1.0;
  bool refuses = true;
  IncrementalFunction world(options, test::ByJets<1, 1>([&refuses](const auto* x, auto* f) {
                              f[0] = x[0] - 3.0;
                              return !refuses || x[0] == 1.0;  // nowhere but where it starts
                            }));
  ASSERT_TRUE(world.applied);
  const UpdateSummary refused = world.solver.Update();
  EXPECT_EQ(refused.termination, Termination::kNoConvergence) << refused.message;
  EXPECT_NE(refused.message.find("refused"), std::string::npos) << refused.message;
  EXPECT_EQ(world.solver.Values(world.x)[0], 1.0);

  refuses = false;
  const UpdateSummary freed = world.solver.Update();
  EXPECT_EQ(freed.termination, Termination::kConvergence) << freed.message;
  EXPECT_NEAR(world.solver.Values(world.x)[0], 3.0, 1e-6);
}

TEST(IncrementalTrust, InfiniteCostIsAFailureThatNamesTheFactor) {
  for (const double batch_share : {0.5, 1.0}) {
    IncrementalOptions options;
    options.batch_share = batch_share;
    IncrementalFunction world(options,
                              test::ScalarFunction([](double x) { return 1e200 * x; }, 1e200));
    ASSERT_TRUE(world.applied);
    const UpdateSummary summary = world.solver.Update();
    EXPECT_EQ(summary.termination, Termination::kFailure);
    EXPECT_NE(summary.message.find("factor 0"), std::string::npos) << summary.message;
    EXPECT_NE(summary.message.find("not finite"), std::string::npos) << summary.message;
    EXPECT_EQ(world.solver.Values(world.x)[0], 1.0);
  }
}

// A landmark that two residuals hold, f = (x + y, (y − 300) / 10,000), as parallax holds a far
// point: its least damping, relative to diag(P), is 200 times what its second pivot is. The third
// is the rest of the cost.
TEST(IncrementalTrust, WhatTheDampingOfALandmarkHidesIsSeenBeforeAClaim) {
  IncrementalOptions options;
  options.batch_share = 1.0;
  options.max_num_iterations = 100;
  IncrementalSolver solver(options);
  const auto family = solver.AddFamily(test::JetFamily<3, 2>([](const auto* p, auto* f) {
    f[0] = p[0] + p[1];
    f[1] = 1e-4 * (p[1] - 300.0);
    f[2] = 0.0 * p[0] + 1.0;
  }));
  GraphEdit edit(solver.graph());
  const double start[2] = {0.0, 0.0};
  edit.AddFactor(family, 0, {edit.AddVariable(start, 2, Role::kLandmark)});
  ASSERT_TRUE(solver.Apply(edit).ok());
  const UpdateSummary summary = solver.Update();
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_LE(summary.final_cost - 0.5, options.function_tolerance);
}

// A frame and a landmark with one factor, whose residual is a function of both; solved once by the
// incremental solver from beginning to end.
UpdateSummary SolveTwo(const std::shared_ptr<FunctionFamily>& of_both, const double* frame,
                       const double* landmark, double* found) {
  IncrementalOptions options;
  options.batch_share = 1.0;
  options.max_num_iterations = 100;
  options.initial_damping = options.min_damping;
  IncrementalSolver solver(options);
  const auto family = solver.AddFamily(of_both);
  GraphEdit edit(solver.graph());
  const VariableId id = edit.AddVariable(frame, 2, Role::kFrame);
  edit.AddFactor(family, 0, {id, edit.AddVariable(landmark, 1, Role::kLandmark)});
  EXPECT_TRUE(solver.Apply(edit).ok());
  const UpdateSummary summary = solver.Update();
  std::copy_n(solver.Values(id), 2, found);
  return summary;
}

// Along y a saddle at 0, and minima at ±√½: the model has a curvature of one there, and the cost of
// minus one. The first step is all about x and keeps its promise; the model then sees 0.04
// tolerances left.
TEST(IncrementalTrust, OneStepThatWasAboutOtherThingsShowsNoMinimum) {
  const auto family = test::JetFamily<4, 2, 1>([](const auto* p, const auto* z, auto* f) {
    f[0] = 100.0 * (p[0] - 1.0);
    f[1] = 1.0 - p[1] * p[1];
    f[2] = p[1];
    f[3] = z[0];
  });
  const double frame[2] = {0.9, 1e-4}, landmark = 0.0;
  double found[2];
  const UpdateSummary summary = SolveTwo(family, frame, &landmark, found);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_NEAR(found[1], std::sqrt(0.5), 1e-2) << summary.FullReport();
}

// The landmark is held well where the frame is, and the two together hardly at all: along that
// direction the cost is a hundredth as stiff as the landmark's least damping. The last residual is
// the rest of the cost.
TEST(IncrementalTrust, WhatTheDampingOfALandmarkHidesOfAFrameIsSeenBeforeAClaim) {
  const auto family = test::JetFamily<4, 2, 1>([](const auto* p, const auto* z, auto* f) {
    f[0] = 100.0 * (p[0] - 1.0);
    f[1] = z[0] - p[1];
    f[2] = 1e-4 * (p[1] - 26.0);
    f[3] = 0.0 * p[0] + 1.0;
  });
  const double frame[2] = {0.9, 0.0}, landmark = 0.0;
  double found[2];
  const UpdateSummary summary = SolveTwo(family, frame, &landmark, found);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_LE(summary.final_cost - 0.5, 0.5 * IncrementalOptions().function_tolerance);
}

// Two frames whose sum is held well, and whose difference is as stiff as s times that: less than μ
// at its floor. There are `tolerances` to gain along it.
UpdateSummary SolveWeakPair(double stiffness, double tolerances, double start_of_sum,
                            IncrementalOptions options = IncrementalOptions()) {
  options.batch_share = 1.0;
  options.max_num_iterations = 100;
  options.initial_damping = options.min_damping;
  IncrementalSolver solver(options);
  const double weight = std::sqrt(stiffness);
  const double difference = std::sqrt(2.0 * tolerances * 0.5 * options.function_tolerance);
  const auto family =
      solver.AddFamily(test::JetFamily<3, 1, 1>([=](const auto* a, const auto* b, auto* f) {
        f[0] = a[0] + b[0];
        f[1] = weight * (a[0] - b[0]) - difference;
        f[2] = 0.0 * a[0] + 1.0;
      }));
  GraphEdit edit(solver.graph());
  const double first = start_of_sum, second = 0.0;
  const VariableId id = edit.AddVariable(&first, 1, Role::kFrame);
  edit.AddFactor(family, 0, {id, edit.AddVariable(&second, 1, Role::kFrame)});
  EXPECT_TRUE(solver.Apply(edit).ok());
  return solver.Update();
}

TEST(IncrementalTrust, WhatTheDampingOfFramesHidesIsSeenBeforeAClaim) {
  // After a step of the sum, and where the sum has nothing to gain.
  for (const double start_of_sum : {1.0, 0.0}) {
    for (const double stiffness : {1e-9, 1e-10}) {
      const UpdateSummary summary = SolveWeakPair(stiffness, 20.0, start_of_sum);
      EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      EXPECT_LE(summary.final_cost - 0.5, 0.5 * IncrementalOptions().function_tolerance)
          << stiffness << " from " << start_of_sum << "\n"
          << summary.FullReport();
    }
  }
}

TEST(IncrementalTrust, DampingStaysAtItsFloorWhereTheUserWantsIt) {
  IncrementalOptions options;
  options.claim_damping_share = 1.0;
  const UpdateSummary summary = SolveWeakPair(1e-10, 20.0, 1.0, options);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_GT(summary.final_cost - 0.5, 5.0 * options.function_tolerance) << "half of it is seen";
  for (const UpdateIteration& iteration : summary.iterations) {
    EXPECT_GE(iteration.damping, options.min_damping);
  }
}

// Each step at the floor would take a twentieth of what is left.
TEST(IncrementalTrust, StepsThatTheDampingKeepsShortAreDampedLess) {
  const UpdateSummary summary = SolveWeakPair(2.5e-10, 1000.0, 1.0);
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_LE(summary.final_cost - 0.5, 0.5 * IncrementalOptions().function_tolerance);
  EXPECT_LE(summary.num_iterations, 8) << summary.FullReport();
}

}  // namespace
}  // namespace inceres
