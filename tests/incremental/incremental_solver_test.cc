// The solver that remembers, against the batch solver on the same problem.

#include "inceres/solver/incremental_solver.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/losses.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/solver.h"
#include "incremental/incremental_function.h"
#include "support/test_families.h"
#include "support/values_held.h"
#include "tools/sim/street_scene.h"

namespace inceres {
namespace {

using test::IncrementalFunction;

// A simulated street whose cameras arrive one by one, with the points that two cameras so far see.
// The first two hold the gauge at their true poses: held at noisy ones they would keep every
// residual large, where Huber's loss converges slowly.
class Street {
 public:
  explicit Street(const IncrementalOptions& options)
      : solver(options),
        reprojections_(solver.AddFamily(std::make_shared<BalReprojectionFamily>())) {
    StreetSceneOptions scene_options;
    scene_options.num_cameras = 10;
    scene_options.num_points = 300;
    scene_options.num_observations = 1300;
    StreetScene scene;
    EXPECT_TRUE(GenerateStreetScene(scene_options, &scene).ok());
    problem_ = scene.problem;
    std::copy_n(scene.truth.cameras.begin(), 2 * 9, problem_.cameras.begin());
    points_.assign(problem_.num_points, -1);
    sightings_.resize(problem_.num_points);
  }

  int num_cameras() const { return problem_.num_cameras; }

  void AddCamera() {
    GraphEdit edit(solver.graph());
    const int camera = static_cast<int>(cameras_.size());
    cameras_.push_back(edit.AddVariable(problem_.cameras.data() + 9 * camera, 9, Role::kFrame));
    edit.SetConstant(cameras_.back(), camera < 2);
    for (const auto& observation : problem_.observations) {
      if (observation.camera != camera) {
        continue;
      }
      auto& sightings = sightings_[observation.point];
      sightings.push_back({camera, observation.x, observation.y});
      VariableId& point = points_[observation.point];
      if (point >= 0) {
        Observe(sightings.back(), point, &edit);
      } else if (sightings.size() == 2) {
        point =
            edit.AddVariable(problem_.points.data() + 3 * observation.point, 3, Role::kLandmark);
        Observe(sightings[0], point, &edit);
        Observe(sightings[1], point, &edit);
      }
    }
    const Status status = solver.Apply(edit);
    EXPECT_TRUE(status.ok()) << status.message;
  }

  // The minimum the batch solver finds from the values held now.
  double BatchMinimum() const {
    FactorGraph graph = test::AtValuesHeld(solver);
    SolverOptions options;
    options.function_tolerance = 1e-14;
    options.parameter_tolerance = 0.0;
    return Solve(options, &graph).final_cost;
  }

  IncrementalSolver solver;

 private:
  struct Sighting {
    int camera;
    double x;
    double y;
  };

  void Observe(const Sighting& sighting, VariableId point, GraphEdit* edit) {
    edit->AddFactor(reprojections_, {sighting.x, sighting.y}, {cameras_[sighting.camera], point},
                    loss_);
  }

  BalProblem problem_;
  FamilyHandle<BalReprojectionFamily> reprojections_;
  std::shared_ptr<const Loss> loss_ = std::make_shared<HuberLoss>(1.0);
  std::vector<VariableId> cameras_;
  std::vector<VariableId> points_;
  std::vector<std::vector<Sighting>> sightings_;
};

class IncrementalStreet : public testing::TestWithParam<double> {};

TEST_P(IncrementalStreet, EveryStepEndsAtTheBatchMinimum) {
  IncrementalOptions options;
  options.function_tolerance = 1e-9;
  options.relinearization_share = GetParam();
  options.truncation_share = GetParam();
  Street street(options);
  street.AddCamera();
  for (int camera = 1; camera < street.num_cameras(); ++camera) {
    street.AddCamera();
    const UpdateSummary summary = street.solver.Update();
    EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
    EXPECT_EQ(summary.final_cost, street.solver.cost());
    EXPECT_LT(summary.final_cost, summary.initial_cost);
    const double minimum = street.BatchMinimum();
    EXPECT_LE(summary.final_cost - minimum, 1e-7 * minimum) << "camera " << camera;
  }
}

// 0: every factor that moved is linearized anew, and everything moves: the batch method.
INSTANTIATE_TEST_SUITE_P(Shares, IncrementalStreet, testing::Values(0.0, 0.1));

TEST(IncrementalSolver, DoesLessWhenLessHasChanged) {
  Street street(IncrementalOptions{});
  for (int camera = 0; camera < street.num_cameras() - 2; ++camera) {
    street.AddCamera();
  }
  const UpdateSummary first = street.solver.Update();
  ASSERT_EQ(first.termination, Termination::kConvergence);
  const UpdateSummary nothing_new = street.solver.Update();
  EXPECT_EQ(nothing_new.termination, Termination::kConvergence);
  EXPECT_EQ(nothing_new.num_relinearized_factors, 0);
  EXPECT_EQ(nothing_new.num_eliminated_landmarks, 0);
  EXPECT_EQ(nothing_new.num_iterations, 0);
  EXPECT_EQ(nothing_new.num_evaluated_factors, 0);
  EXPECT_EQ(nothing_new.final_cost, first.final_cost);
  double seconds = nothing_new.seconds;
  for (int again = 0; again < 20; ++again) {  // the machine may be busy: the best counts
    seconds = std::min(seconds, street.solver.Update().seconds);
  }
  EXPECT_LT(seconds, 1e-3 * first.seconds);
  street.AddCamera();
  street.solver.Update();  // S is formed now, which the batch solver left
  street.AddCamera();
  const UpdateSummary one_more = street.solver.Update();
  EXPECT_LT(one_more.num_relinearized_factors, first.num_relinearized_factors / 2);
  EXPECT_GT(one_more.num_relinearized_factors, 0);
}

TEST(IncrementalSolver, StopsAtItsLimitsWithTheBestStateSoFar) {
  IncrementalOptions options;
  options.max_num_iterations = 1;
  Street street(options);
  for (int camera = 0; camera < street.num_cameras(); ++camera) {
    street.AddCamera();
  }
  const UpdateSummary one = street.solver.Update();
  EXPECT_EQ(one.termination, Termination::kNoConvergence);
  EXPECT_EQ(one.num_iterations, 1);
  EXPECT_LT(one.final_cost, one.initial_cost);
  const UpdateSummary next = street.solver.Update();
  EXPECT_NEAR(next.initial_cost, one.final_cost, 1e-12 * one.final_cost)
      << "it goes on where it stopped";
}

TEST(IncrementalSolver, ParksALandmarkWithoutInformation) {
  IncrementalOptions options;
  options.batch_share = 1.0;  // the batch solver damps it instead
  IncrementalSolver solver(options);
  const double start = 7.0;
  const auto blind = [](double frame, double) { return frame - 2.0; };
  const auto family = solver.AddFamily(test::ScalarFamily(blind, 1.0, 0.0));
  GraphEdit edit(solver.graph());
  const VariableId frame = edit.AddVariable(&start, 1, Role::kFrame);
  const VariableId landmark = edit.AddVariable(&start, 1, Role::kLandmark);
  edit.AddFactor(family, 0, {frame, landmark});
  ASSERT_TRUE(solver.Apply(edit).ok());
  const UpdateSummary summary = solver.Update();
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  EXPECT_EQ(summary.num_undetermined_landmarks, 1);
  EXPECT_NEAR(*solver.Values(frame), 2.0, 1e-6);
  EXPECT_EQ(*solver.Values(landmark), 7.0);
}

TEST(IncrementalSolver, AFactorThatFailsIsNamedAndMayRecover) {
  IncrementalSolver solver{IncrementalOptions{}};
  bool broken = false;
  const auto moody = test::JetFamily<1, 1>([&broken](int i, const auto* x, auto* f) {
    f[0] = x[0] - i;
    return !(broken && i == 1);
  });
  const double start = 5.0;
  const auto family = solver.AddFamily(moody);
  GraphEdit edit(solver.graph());
  const VariableId x = edit.AddVariable(&start, 1, Role::kFrame);
  edit.AddFactor(family, 0, {x});
  ASSERT_TRUE(solver.Apply(edit).ok());
  ASSERT_EQ(solver.Update().termination, Termination::kConvergence);
  EXPECT_NEAR(*solver.Values(x), 0.0, 1e-6);

  broken = true;
  edit.Restart();
  edit.AddFactor(family, 0, {x});
  ASSERT_TRUE(solver.Apply(edit).ok());
  const double before = *solver.Values(x);
  const double cost = solver.cost();
  const UpdateSummary failed = solver.Update();
  EXPECT_EQ(failed.termination, Termination::kFailure);
  EXPECT_NE(failed.message.find("factor 1 of function"), std::string::npos) << failed.message;
  EXPECT_EQ(*solver.Values(x), before);
  EXPECT_EQ(failed.final_cost, cost);  // of what could be evaluated
  EXPECT_EQ(solver.cost(), cost);

  broken = false;
  EXPECT_EQ(solver.Update().termination, Termination::kConvergence);
  EXPECT_NEAR(*solver.Values(x), 0.5, 1e-3);  // within the function tolerance
}

// exp(x) creeps down; its Jacobian fails below 0.5, which the first step reaches.
TEST(IncrementalSolver, AFailureAfterAStepKeepsTheStepAndItsCost) {
  const auto halting = [](int, const double* const* parameters, double* residuals,
                          double** jacobians) {
    residuals[0] = std::exp(parameters[0][0]);
    if (jacobians != nullptr) {
      jacobians[0][0] = residuals[0];
    }
    return jacobians == nullptr || parameters[0][0] > 0.5;
  };
  IncrementalOptions options;
  options.batch_share = 1.0;
  IncrementalFunction problem(options, halting);
  ASSERT_TRUE(problem.applied);
  IncrementalSolver& solver = problem.solver;
  const UpdateSummary failed = solver.Update();
  EXPECT_EQ(failed.termination, Termination::kFailure);
  EXPECT_NE(failed.message.find("factor 0 of function"), std::string::npos) << failed.message;
  EXPECT_NEAR(*solver.Values(problem.x), 0.0, 1e-3);
  const double cost = 0.5 * std::exp(2.0 * *solver.Values(problem.x));
  EXPECT_NEAR(failed.final_cost, cost, 1e-12);
  EXPECT_EQ(solver.cost(), failed.final_cost);
}

// A line whose map has no Jacobian below 0.5.
class HalfLine final : public Manifold {
 public:
  int AmbientSize() const override { return 1; }
  int TangentSize() const override { return 1; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    *x_plus_delta = *x + *delta;
    return true;
  }
  bool PlusJacobian(const double* x, double* jacobian) const override {
    *jacobian = 1.0;
    return *x > 0.5;
  }
};

// The same where it is the manifold that fails.
TEST(IncrementalSolver, AManifoldThatFailsAfterAStepKeepsTheStepAndItsCost) {
  IncrementalOptions options;
  options.batch_share = 1.0;
  IncrementalSolver solver(options);
  const auto exp = [](double x) { return std::exp(x); };
  const auto family = solver.AddFamily(test::ScalarFamily(exp, exp));
  const double start = 1.0;
  GraphEdit edit(solver.graph());
  const VariableId x = edit.AddVariable(&start, 1, Role::kFrame, std::make_shared<HalfLine>());
  edit.AddFactor(family, 0, {x});
  ASSERT_TRUE(solver.Apply(edit).ok());
  const UpdateSummary failed = solver.Update();
  EXPECT_EQ(failed.termination, Termination::kFailure);
  EXPECT_NE(failed.message.find("has no Jacobian here"), std::string::npos) << failed.message;
  EXPECT_LT(*solver.Values(x), 0.5);
  EXPECT_NEAR(failed.final_cost, 0.5 * std::exp(2.0 * *solver.Values(x)), 1e-12);
  EXPECT_EQ(solver.cost(), failed.final_cost);
}

TEST(IncrementalSolver, AnEditThatCannotBeIsRefusedUntouched) {
  IncrementalSolver solver{IncrementalOptions{}};
  const double start = std::nan("");
  GraphEdit edit(solver.graph());
  edit.AddVariable(&start, 1, Role::kFrame);
  const Status status = solver.Apply(edit);
  EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
  EXPECT_NE(status.message.find("variable 0"), std::string::npos) << status.message;
  EXPECT_EQ(solver.graph().num_variables(), 0);
}

// One residual x − m; setting a measurement throws when it is told to.
class MoodyPriors final : public AmbientFamily<MoodyPriors> {
 public:
  using Measurement = double;
  MoodyPriors() : AmbientFamily(1, {{1, 1}}) {}
  void Place(int index, double measurement) {
    if (broken) {
      throw std::runtime_error("no measurement today");
    }
    PlaceIn(&measurements_, index, measurement);
  }
  int size() const override { return static_cast<int>(measurements_.size()); }
  const char* Name() const override { return "moody prior"; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    residuals[0] = parameters[0][0] - measurements_[static_cast<std::size_t>(i)];
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      jacobians[0][0] = 1.0;
    }
    return true;
  }

  bool broken = false;

 private:
  std::vector<double> measurements_;
};

// What a family throws passes through, and neither the graph nor the solver has followed the edit.
TEST(IncrementalSolver, AFamilyThatThrowsLeavesTheEditUndone) {
  IncrementalOptions options;
  options.batch_share = 2.0;
  options.function_tolerance = 1e-13;
  IncrementalSolver solver(options);
  const auto family = solver.AddFamily(std::make_shared<MoodyPriors>());
  const double start = 0.0;
  GraphEdit edit(solver.graph());
  const VariableId x = edit.AddVariable(&start, 1, Role::kFrame);
  const FactorId first = edit.AddFactor(family, 1.0, {x});
  const FactorId second = edit.AddFactor(family, 2.0, {x});
  ASSERT_TRUE(solver.Apply(edit).ok());
  ASSERT_EQ(solver.Update().termination, Termination::kConvergence);
  EXPECT_NEAR(*solver.Values(x), 1.5, 1e-6);
  const std::int64_t revision = solver.graph().revision();

  edit.Restart();
  edit.RemoveFactor(first);
  edit.SetMeasurement(second, family, 4.0);
  family->broken = true;
  EXPECT_THROW(static_cast<void>(solver.Apply(edit)), std::runtime_error);
  EXPECT_EQ(solver.graph().revision(), revision);
  EXPECT_EQ(solver.graph().num_factors(), 2);
  EXPECT_TRUE(solver.graph().HasFactor(first.family, first.index));
  EXPECT_EQ(solver.Update().termination, Termination::kConvergence);
  EXPECT_NEAR(*solver.Values(x), 1.5, 1e-6);

  family->broken = false;
  ASSERT_TRUE(solver.Apply(edit).ok()) << "it can be tried again";
  EXPECT_EQ(solver.graph().num_factors(), 1);
  ASSERT_EQ(solver.Update().termination, Termination::kConvergence);
  EXPECT_NEAR(*solver.Values(x), 4.0, 1e-6);
}

TEST(IncrementalOptions, EachFieldIsValidatedByName) {
  const auto expect_named = [](const char* field,
                               const std::function<void(IncrementalOptions*)>& spoil) {
    IncrementalOptions options;
    ASSERT_TRUE(options.Validate().ok());
    spoil(&options);
    const Status status = options.Validate();
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_NE(status.message.find(field), std::string::npos) << status.message;
    EXPECT_EQ(IncrementalSolver(options).Update().termination, Termination::kFailure);
  };
  expect_named("max_num_iterations", [](IncrementalOptions* o) { o->max_num_iterations = -1; });
  expect_named("max_solver_time_in_seconds",
               [](IncrementalOptions* o) { o->max_solver_time_in_seconds = 0.0; });
  expect_named("function_tolerance", [](IncrementalOptions* o) { o->function_tolerance = -1.0; });
  expect_named("min_relative_decrease",
               [](IncrementalOptions* o) { o->min_relative_decrease = std::nan(""); });
  expect_named("max_factor_evaluations",
               [](IncrementalOptions* o) { o->max_factor_evaluations = 0; });
  expect_named("num_threads", [](IncrementalOptions* o) { o->num_threads = 0; });
  expect_named("min_damping", [](IncrementalOptions* o) { o->min_damping = 0.0; });
  expect_named("claim_damping_share", [](IncrementalOptions* o) { o->claim_damping_share = 0.0; });
  expect_named("claim_damping_share", [](IncrementalOptions* o) { o->claim_damping_share = 1.1; });
  expect_named("initial_damping", [](IncrementalOptions* o) { o->initial_damping = 1e-12; });
  expect_named("max_damping", [](IncrementalOptions* o) { o->max_damping = 1e-6; });
  expect_named("relinearization_share",
               [](IncrementalOptions* o) { o->relinearization_share = -0.5; });
  expect_named("max_new_frame_steps", [](IncrementalOptions* o) { o->max_new_frame_steps = -1; });
  expect_named("truncation_share", [](IncrementalOptions* o) { o->truncation_share = -0.5; });
}

}  // namespace
}  // namespace inceres
