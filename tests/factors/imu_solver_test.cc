// Solves with IMU factors whose biases turn out far from those they were integrated at: the solvers
// have them integrated anew between iterations, and end with the cost of factors integrated at the
// biases found.
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "factors/imu_support.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"

namespace inceres {
namespace {

constexpr int kFrames = 12;
constexpr int kSamplesPerFrame = 40;
const double kGyrBias[3] = {0.2, -0.3, 0.15};
const double kAccBias[3] = {0.3, -0.1, 0.2};

double Deviation(double sigma) {
  return 1.0 / sigma;
}

// A trip with its measurements: samples with biases on them between frames, poses at the frames.
// Everything is integrated at biases of 0.
class Trip {
 public:
  explicit Trip(const ImuOptions& options)
      : imu_factors{-1, std::make_shared<ImuFactorFamily>()},
        pose_priors{
            -1, std::make_shared<PosePriorFamily>(Left(options) ? PosePriorFamily::Side::kLeft
                                                                : PosePriorFamily::Side::kRight)},
        first_prior{-1, std::make_shared<DiagonalPriorFamily>(9)},
        options_(options),
        gyr_column_(options.conventions.bias_order == ImuConventions::BiasOrder::kGyrFirst ? 3
                                                                                           : 6) {
    if (Left(options)) {
      manifold_ = std::make_shared<LeftPoseManifold>();
    } else {
      manifold_ = std::make_shared<PoseManifold>();
    }
    test::Random random(81);
    const std::vector<ImuSample> all =
        test::LivelySamples(random, (kFrames - 1) * kSamplesPerFrame, 0.005);
    State state;
    for (int k = 0; k < 3; ++k) {
      state.speed_bias[k] = 0.5 * random.Unit();
    }
    for (int frame = 0; frame < kFrames; ++frame) {
      if (frame > 0) {
        std::vector<ImuSample> true_samples(all.begin() + (frame - 1) * kSamplesPerFrame,
                                            all.begin() + frame * kSamplesPerFrame + 1);
        const ImuPreintegrator truth = test::Integrated(options, true_samples);
        EXPECT_TRUE(PropagateImu(truth, state.pose, state.speed_bias, nullptr, state.pose,
                                 state.speed_bias, nullptr)
                        .ok());
        for (ImuSample& sample : true_samples) {
          for (int k = 0; k < 3; ++k) {
            sample.gyr[k] += kGyrBias[k] + 0.002 * random.Unit();
            sample.acc[k] += kAccBias[k] + 0.02 * random.Unit();
          }
        }
        measured_.push_back(true_samples);
      }
      states_.push_back(state);
      seen_.push_back(state);
      for (int k = 0; k < 3; ++k) {
        seen_.back().pose[k] += 0.01 * random.Unit();
      }
    }
  }

  // Builder is a FactorGraph or a GraphEdit; its families are there.
  template <typename Builder>
  void AddFrame(Builder* builder, const double* gyr_bias = test::kNoBias,
                const double* acc_bias = test::kNoBias) {
    const auto frame = static_cast<int>(poses.size());
    poses.push_back(builder->AddVariable(seen_[frame].pose, 7, Role::kFrame, manifold_));
    speed_biases.push_back(builder->AddVariable(states_[frame].speed_bias, 9, Role::kFrame));
    PosePriorFamily::Measurement seen;
    std::copy_n(seen_[frame].pose, 7, seen.pose);
    for (int k = 0; k < 6; ++k) {
      seen.sqrt_information[7 * k] = Deviation(k < 3 ? 0.01 : 0.002);
    }
    builder->AddFactor(pose_priors, seen, {poses.back()});
    if (frame == 0) {
      builder->AddFactor(first_prior,
                         {std::vector<double>(9, 0.0), std::vector<double>(9, Deviation(1.0))},
                         {speed_biases.back()});
    } else {
      const ImuPreintegrator imu =
          test::Integrated(options_, measured_[frame - 1], gyr_bias, acc_bias);
      builder->AddFactor(
          imu_factors, imu,
          {poses[frame - 1], speed_biases[frame - 1], poses[frame], speed_biases[frame]});
    }
  }

  // The same with factors integrated at the biases of given values, and nothing to be done about
  // them.
  FactorGraph FreshGraph(const std::vector<const double*>& values) {
    options_.max_rotation_change = options_.max_speed_change =
        std::numeric_limits<double>::infinity();
    FactorGraph graph = NewGraph();
    for (int frame = 0; frame < kFrames; ++frame) {
      const double* at = frame == 0 ? values[1] : values[2 * (frame - 1) + 1];
      AddFrame(&graph, at + gyr_column_, at + 9 - gyr_column_);
      graph.SetValues(poses.back(), values[2 * frame]);
      graph.SetValues(speed_biases.back(), values[2 * frame + 1]);
    }
    return graph;
  }

  FactorGraph NewGraph() {
    FactorGraph graph;
    AddFamilies(&graph);
    return graph;
  }
  template <typename Owner>
  void AddFamilies(Owner* owner) {
    imu_factors = owner->AddFamily(imu_factors.family);
    pose_priors = owner->AddFamily(pose_priors.family);
    first_prior = owner->AddFamily(first_prior.family);
  }

  void ExpectBiasesFound(const double* speed_bias) const {
    for (int k = 0; k < 3; ++k) {
      EXPECT_NEAR(speed_bias[gyr_column_ + k], kGyrBias[k], 0.02);
      EXPECT_NEAR(speed_bias[9 - gyr_column_ + k], kAccBias[k], 0.15);
    }
  }

  FamilyHandle<ImuFactorFamily> imu_factors;
  FamilyHandle<PosePriorFamily> pose_priors;
  FamilyHandle<DiagonalPriorFamily> first_prior;
  std::vector<VariableId> poses;
  std::vector<VariableId> speed_biases;

 private:
  struct State {
    double pose[7] = {0, 0, 0, 0, 0, 0, 1};
    double speed_bias[9] = {};
  };
  static bool Left(const ImuOptions& options) {
    return options.conventions.perturbation == ImuConventions::Perturbation::kLeft;
  }

  ImuOptions options_;
  int gyr_column_;
  std::shared_ptr<const Manifold> manifold_;
  std::vector<std::vector<ImuSample>> measured_;
  std::vector<State> states_;
  std::vector<State> seen_;
};

ImuOptions Tight(const ImuConventions& conventions) {
  ImuOptions options;
  options.conventions = conventions;
  options.noise = {2e-3, 2e-2, 1e-4, 1e-3};
  if (conventions.noise == ImuConventions::Noise::kPerSample) {
    options.noise = {3e-2, 3e-1, 1e-3, 1e-2};
  }
  options.max_rotation_change = options.max_speed_change = 1e-7;
  return options;
}

// At these values: the cost of fresh factors, and whether a solve of them finds nothing better.
void ExpectOptimumOfFreshFactors(const ImuOptions& options,
                                 const std::vector<const double*>& values, double cost) {
  Trip fresh(options);
  FactorGraph graph = fresh.FreshGraph(values);
  SolverOptions solver_options;
  solver_options.function_tolerance = 1e-14;
  const Summary summary = Solve(solver_options, &graph);
  ASSERT_TRUE(summary.IsSolutionUsable()) << summary.message;
  EXPECT_EQ(summary.work.num_recentered_factors, 0);
  EXPECT_NEAR(summary.initial_cost, cost, 1e-7 * cost);
  EXPECT_NEAR(summary.final_cost, cost, 1e-6 * cost);
}

std::vector<const double*> ValuesOf(const Trip& trip, const FactorGraph& graph) {
  std::vector<const double*> values;
  for (std::size_t k = 0; k < trip.poses.size(); ++k) {
    values.push_back(graph.Values(trip.poses[k]));
    values.push_back(graph.Values(trip.speed_biases[k]));
  }
  return values;
}

TEST(ImuSolver, ABatchSolveEndsAtTheOptimumOfFactorsIntegratedAtItsBiases) {
  for (const ImuConventions& conventions : {ImuConventions(), ImuConventions::Vins(),
                                            ImuConventions::Okvis(), ImuConventions::Xrslam()}) {
    for (const auto strategy :
         {TrustRegionStrategyKind::kLevenbergMarquardt, TrustRegionStrategyKind::kDogleg}) {
      const ImuOptions options = Tight(conventions);
      Trip trip(options);
      FactorGraph graph = trip.NewGraph();
      for (int frame = 0; frame < kFrames; ++frame) {
        trip.AddFrame(&graph);
      }
      SolverOptions solver_options;
      solver_options.strategy = strategy;
      solver_options.function_tolerance = 1e-12;
      const Summary summary = Solve(solver_options, &graph);
      EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      EXPECT_GE(summary.work.num_recentered_factors, kFrames - 1);
      trip.ExpectBiasesFound(graph.Values(trip.speed_biases[kFrames / 2]));
      ExpectOptimumOfFreshFactors(options, ValuesOf(trip, graph), summary.final_cost);
    }
  }
}

// What the test above would miss if nothing were integrated anew.
TEST(ImuSolver, WithoutReintegrationTheCostIsAnother) {
  ImuOptions options = Tight(ImuConventions());
  double costs[2];
  for (const bool reintegrate : {false, true}) {
    options.max_rotation_change = options.max_speed_change =
        reintegrate ? 1e-7 : std::numeric_limits<double>::infinity();
    Trip trip(options);
    FactorGraph graph = trip.NewGraph();
    for (int frame = 0; frame < kFrames; ++frame) {
      trip.AddFrame(&graph);
    }
    const Summary summary = Solve(SolverOptions(), &graph);
    EXPECT_EQ(summary.work.num_recentered_factors > 0, reintegrate);
    costs[reintegrate ? 1 : 0] = summary.final_cost;
  }
  EXPECT_GT(std::fabs(costs[0] - costs[1]), 1e-4 * costs[1]);
}

TEST(ImuSolver, IncrementalUpdatesEndThereToo) {
  for (const double batch_share : {0.5, 1.0}) {
    const ImuOptions options = Tight(ImuConventions::Vins());
    Trip trip(options);
    IncrementalOptions solver_options;
    solver_options.batch_share = batch_share;
    solver_options.function_tolerance = 1e-10;
    IncrementalSolver solver(solver_options);
    trip.AddFamilies(&solver);
    int num_recentered = 0;
    for (int frame = 0; frame < kFrames; ++frame) {
      GraphEdit edit(solver.graph());
      trip.AddFrame(&edit);
      ASSERT_TRUE(solver.Apply(edit).ok());
      const UpdateSummary summary = solver.Update();
      ASSERT_EQ(summary.termination, Termination::kConvergence) << summary.message;
      num_recentered += summary.num_recentered_factors;
    }
    EXPECT_GE(num_recentered, kFrames - 1);
    std::vector<const double*> values;
    for (std::size_t k = 0; k < trip.poses.size(); ++k) {
      values.push_back(solver.Values(trip.poses[k]));
      values.push_back(solver.Values(trip.speed_biases[k]));
    }
    trip.ExpectBiasesFound(values[kFrames + 1]);
    ExpectOptimumOfFreshFactors(options, values, solver.cost());
  }
}

// The user's samples of a frame that is dropped are appended to those of the one before, in place.
TEST(ImuSolver, AMeasurementCanBeReplaced) {
  const ImuOptions options = Tight(ImuConventions());
  Trip trip(options);
  IncrementalSolver solver((IncrementalOptions()));
  trip.AddFamilies(&solver);
  GraphEdit edit(solver.graph());
  for (int frame = 0; frame < 3; ++frame) {
    trip.AddFrame(&edit);
  }
  ASSERT_TRUE(solver.Apply(edit).ok());
  ASSERT_EQ(solver.Update().termination, Termination::kConvergence);
  ImuPreintegrator merged = trip.imu_factors->measurement(0);
  const std::vector<ImuSample>& rest = trip.imu_factors->measurement(1).samples();
  ASSERT_TRUE(merged.Append({rest.begin() + 1, rest.end()}).ok());
  const VariableId kept[4] = {trip.poses[0], trip.speed_biases[0], trip.poses[2],
                              trip.speed_biases[2]};
  GraphEdit drop(solver.graph());
  drop.RemoveVariable(trip.poses[1]);
  drop.RemoveVariable(trip.speed_biases[1]);
  drop.AddFactor(trip.imu_factors, merged, {kept, kept + 4});
  ASSERT_TRUE(solver.Apply(drop).ok());
  const UpdateSummary summary = solver.Update();
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(solver.graph().num_factors(), 4);
}

TEST(ImuSolver, AFactorWithoutInformationIsNamed) {
  Trip trip(Tight(ImuConventions()));
  FactorGraph graph = trip.NewGraph();
  trip.AddFrame(&graph);
  trip.AddFrame(&graph);
  trip.imu_factors->Place(0, ImuPreintegrator());
  const std::vector<double> before = graph.state();
  const Summary summary = Solve(SolverOptions(), &graph);
  EXPECT_EQ(summary.termination, Termination::kFailure);
  EXPECT_NE(summary.detail.find("factor 0 of IMU preintegration"), std::string::npos)
      << summary.detail;
  EXPECT_NE(summary.detail.find("no information matrix"), std::string::npos) << summary.detail;
  EXPECT_EQ(graph.state(), before);
}

}  // namespace
}  // namespace inceres
