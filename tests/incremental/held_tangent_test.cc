// Of a constant a factor asks for the number of values only: one that was free may be held in slots
// where it could not move. What takes it up then sees a constant without a place in the system, and
// it is not set free while that is there.

#include <array>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/problem/ambient_family.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/incremental_solver.h"
#include "inceres/solver/solver.h"
#include "support/random_values.h"
#include "support/values_held.h"

namespace inceres {
namespace {

// batch_share 1: the batch solver never helps.
IncrementalOptions Exactly() {
  IncrementalOptions options;
  options.batch_share = 1.0;
  options.function_tolerance = 1e-10;
  options.max_num_iterations = 200;
  return options;
}

void Apply(const GraphEdit& edit, IncrementalSolver* solver) {
  const Status status = solver->Apply(edit);
  ASSERT_TRUE(status.ok()) << status.message;
}

// Converged, at the minimum that a batch solve finds from there.
void ExpectMinimum(IncrementalSolver* solver) {
  const UpdateSummary summary = solver->Update();
  EXPECT_EQ(summary.termination, Termination::kConvergence) << summary.message;
  SolverOptions options;
  options.function_tolerance = 1e-14;
  FactorGraph graph = test::AtValuesHeld(*solver);
  const Summary batch = Solve(options, &graph);
  ASSERT_TRUE(batch.IsSolutionUsable()) << batch.message;
  EXPECT_NEAR(summary.final_cost, batch.final_cost, 1e-8 * batch.final_cost);
}

// Cameras around points, whose intrinsics a manifold holds. The first one has seen half of the
// points.
struct Cameras {
  static constexpr int kCameras = 6, kPoints = 60;

  Cameras()
      : solver(Exactly()),
        views(solver.AddFamily(std::make_shared<BalReprojectionFamily>(6, 3))),
        views_by_all(solver.AddFamily(std::make_shared<BalReprojectionFamily>(9, 3))),
        priors(solver.AddFamily(std::make_shared<DiagonalPriorFamily>(6, 9, 6))) {
    const auto poses = std::make_shared<SubsetManifold>(9, std::vector<int>{6, 7, 8});
    GraphEdit edit(solver.graph());
    for (int c = 0; c < kCameras; ++c) {
      const std::vector<double> pose = {0.0, 0.0, 0.0, 1.0 - 0.5 * c, 0.1 * c, -6.0};
      std::vector<double> start = pose;
      for (double& value : start) {
        value += c > 0 ? 0.01 * random.Gaussian() : 0.0;
      }
      start.insert(start.end(), {kFocal, 0.0, 0.0});
      cameras.push_back(edit.AddVariable(start.data(), 9, Role::kFrame, poses));
      if (c < 2) {
        edit.AddFactor(priors, {pose, std::vector<double>(6, c == 0 ? 1e3 : 1e1)}, {cameras[c]});
      }
    }
    for (int p = 0; p < kPoints; ++p) {
      const double x[3] = {random.Gaussian(), random.Gaussian(), random.Between(-2.0, 2.0)};
      double start[3];
      for (int k = 0; k < 3; ++k) {
        start[k] = x[k] + 0.05 * random.Gaussian();
      }
      points.push_back(edit.AddVariable(start, 3, Role::kLandmark));
      for (int c = 0; c < kCameras; ++c) {
        const double depth = 6.0 - x[2];
        seen.push_back({kFocal * (x[0] + 1.0 - 0.5 * c) / depth + 0.5 * random.Gaussian(),
                        kFocal * (x[1] + 0.1 * c) / depth + 0.5 * random.Gaussian()});
        if (c > 0 || p % 2 == 0) {
          edit.AddFactor(views, seen.back(), {cameras[c], points[p]});
        }
      }
    }
    Apply(edit, &solver);
  }

  static constexpr double kFocal = 500.0;
  test::Random random{1};
  IncrementalSolver solver;
  FamilyHandle<BalReprojectionFamily> views;
  FamilyHandle<BalReprojectionFamily> views_by_all;  // of a camera that moves with its intrinsics
  FamilyHandle<DiagonalPriorFamily> priors;
  std::vector<VariableId> cameras;
  std::vector<VariableId> points;
  std::vector<BalReprojectionMeasurement> seen;  // by point, then by camera
};

// The other half comes once the first camera is held, or with the edit that holds it.
double CostOfLateViews(bool by_all, bool held_before) {
  Cameras scene;
  ExpectMinimum(&scene.solver);
  GraphEdit edit(scene.solver.graph());
  edit.SetConstant(scene.cameras[0], true);
  if (held_before) {
    Apply(edit, &scene.solver);
    ExpectMinimum(&scene.solver);
    edit.Restart();
  }
  for (int p = 1; p < Cameras::kPoints; p += 2) {
    edit.AddFactor(by_all ? scene.views_by_all : scene.views, scene.seen[p * Cameras::kCameras],
                   {scene.cameras[0], scene.points[p]});
    Apply(edit, &scene.solver);
    ExpectMinimum(&scene.solver);
    edit.Restart();
  }
  return scene.solver.cost();
}

TEST(HeldTangent, ACameraIsSeenByFactorsOfMoreDimensionsAsByItsOwn) {
  const double expected = CostOfLateViews(/*by_all=*/false, /*held_before=*/true);
  for (const bool held_before : {true, false}) {
    EXPECT_NEAR(CostOfLateViews(/*by_all=*/true, held_before), expected, 1e-8 * expected);
  }
}

// x + (y + 0.1 y², 0) − m of a point x on a sphere in R⁴ and y in R², with such a slot for x.
class Sum final : public AmbientFamily<Sum> {
 public:
  using Measurement = std::array<double, 4>;

  Sum(int tangent_size, SlotSpace space)
      : AmbientFamily(4, {{4, tangent_size}, {2, 2}}), space_(space) {}
  void Add(const Measurement& measurement) { measurements_.push_back(measurement); }
  void Place(int index, const Measurement& measurement) {
    PlaceIn(&measurements_, index, measurement);
  }
  int size() const override { return static_cast<int>(measurements_.size()); }
  const char* Name() const override { return "sum"; }
  SlotSpace Space(int s) const override { return s == 0 ? space_ : SlotSpace::kAny; }
  bool EvaluateOne(int i, const double* const* parameters, double* residuals,
                   double** jacobians) const {
    const double* const x = parameters[0];
    const double* const y = parameters[1];
    const bool by_x = jacobians != nullptr && jacobians[0] != nullptr;
    const bool by_y = jacobians != nullptr && jacobians[1] != nullptr;
    asked_for_x = asked_for_x || by_x;
    for (int r = 0; r < 4; ++r) {
      residuals[r] = x[r] - measurements_[static_cast<std::size_t>(i)][static_cast<std::size_t>(r)];
      residuals[r] += r < 2 ? y[r] + 0.1 * y[r] * y[r] : 0.0;
      for (int k = 0; by_x && k < 4; ++k) {
        jacobians[0][4 * r + k] = r == k ? 1.0 : 0.0;
      }
      for (int k = 0; by_y && k < 2; ++k) {
        jacobians[1][2 * r + k] = r == k ? 1.0 + 0.2 * y[r] : 0.0;
      }
    }
    return true;
  }

  mutable bool asked_for_x = false;

 private:
  SlotSpace space_;
  std::vector<Measurement> measurements_;
};

// Such an x with factors of its own, and y with a prior.
struct Sphere {
  Sphere(Role role, int tangent_size, SlotSpace space)
      : solver(Exactly()),
        own(solver.AddFamily(std::make_shared<Sum>(3, SlotSpace::kAny))),
        others(solver.AddFamily(std::make_shared<Sum>(tangent_size, space))) {
    const auto priors = solver.AddFamily(std::make_shared<DiagonalPriorFamily>(2));
    const double start_x[4] = {0.5, 0.5, 0.5, 0.5}, start_y[2] = {0.0, 0.0};
    GraphEdit edit(solver.graph());
    y = edit.AddVariable(start_y, 2, Role::kFrame);
    x = edit.AddVariable(start_x, 4, role, std::make_shared<SphereManifold>(4));
    edit.AddFactor(priors, {{0.3, -0.2}, {1.0, 1.0}}, {y});
    edit.AddFactor(own, {1.0, 0.2, 0.4, 0.6}, {x, y});
    edit.AddFactor(own, {0.7, 0.6, 0.3, 0.1}, {x, y});
    Apply(edit, &solver);
  }

  IncrementalSolver solver;
  FamilyHandle<Sum> own;
  FamilyHandle<Sum> others;  // where x cannot move
  VariableId x = -1;
  VariableId y = -1;
};

// One factor of the others and one more of x's own come while it is held; then other values of it.
FactorId HoldWithOthers(bool held_before, Sphere* sphere) {
  GraphEdit edit(sphere->solver.graph());
  edit.SetConstant(sphere->x, true);
  if (held_before) {
    Apply(edit, &sphere->solver);
    ExpectMinimum(&sphere->solver);
    edit.Restart();
  }
  const FactorId other =
      edit.AddFactor(sphere->others, {0.2, 0.9, 0.1, 0.3}, {sphere->x, sphere->y});
  edit.AddFactor(sphere->own, {0.9, 0.4, 0.2, 0.2}, {sphere->x, sphere->y});
  Apply(edit, &sphere->solver);
  ExpectMinimum(&sphere->solver);
  const double elsewhere[4] = {0.7, 0.1, 0.5, 0.5};
  edit.Restart();
  edit.SetValues(sphere->x, elsewhere);
  Apply(edit, &sphere->solver);
  ExpectMinimum(&sphere->solver);
  EXPECT_FALSE(sphere->others->asked_for_x);
  return other;
}

void FreeWithoutOthers(FactorId other, bool gone_before, Sphere* sphere) {
  GraphEdit edit(sphere->solver.graph());
  edit.SetConstant(sphere->x, false);
  const Status refused = sphere->solver.Apply(edit);
  EXPECT_EQ(refused.code, StatusCode::kInvalidArgument);
  EXPECT_NE(refused.message.find("SetConstant"), std::string::npos) << refused.message;
  edit.Restart();
  edit.RemoveFactor(other);
  if (gone_before) {
    Apply(edit, &sphere->solver);
    ExpectMinimum(&sphere->solver);
    edit.Restart();
  }
  edit.SetConstant(sphere->x, false);
  Apply(edit, &sphere->solver);
  ExpectMinimum(&sphere->solver);
  EXPECT_NE(sphere->solver.Values(sphere->x)[0], 0.7) << "it moves";
}

// Of another size, or of the same size in another space: four or three dimensions of R⁴.
TEST(HeldTangent, NoFactorHasAJacobianForWhatCouldNotMoveInItsSlot) {
  for (const Role role : {Role::kFrame, Role::kLandmark}) {
    for (const bool of_other_size : {true, false}) {
      for (const bool held_before : {true, false}) {
        Sphere sphere(role, of_other_size ? 4 : 3,
                      of_other_size ? SlotSpace::kAny : SlotSpace::kEuclidean);
        ExpectMinimum(&sphere.solver);
        // Once more in the places that are free by then.
        for (int round = 0; round < 2; ++round) {
          const FactorId other = HoldWithOthers(held_before, &sphere);
          FreeWithoutOthers(other, /*gone_before=*/held_before, &sphere);
        }
      }
    }
  }
}

}  // namespace
}  // namespace inceres
