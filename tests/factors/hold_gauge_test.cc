// HoldGauge and the factor of a distance: analytic Jacobians, what is held, what is refused, and
// that nothing but the gauge is.
#include <cmath>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/gauge.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/check_jacobians.h"
#include "inceres/solver/covariance.h"
#include "inceres/solver/solver.h"
#include "support/random_values.h"

namespace inceres {
namespace {

// Cameras on a circle around points, each of which they all see, with noise.
class SmallBundle {
 public:
  explicit SmallBundle(unsigned seed = 3) : random_(seed) {
    const auto family = graph.AddFamily(std::make_shared<BalReprojectionFamily>());
    for (int i = 0; i < 4; ++i) {
      const double angle = 0.3 * i;
      std::vector<double> camera = {0.02 * i, angle, 0.01 * i, 0.4 * i, 0.1 * i,
                                    -6.0,     500.0, 0.01,     0.001};
      cameras.push_back(graph.AddVariable(camera.data(), 9, Role::kFrame));
    }
    for (int k = 0; k < 25; ++k) {
      const std::vector<double> point = random_.Vector(3);
      points.push_back(graph.AddVariable(point.data(), 3, Role::kLandmark));
      for (const VariableId camera : cameras) {
        const double* parameters[] = {graph.Values(camera), graph.Values(points.back())};
        BalReprojectionFamily alone;
        alone.Add({0.0, 0.0});
        double seen[2];
        EXPECT_FALSE(alone.Evaluate({0, 1, parameters, nullptr, seen, nullptr}).failed());
        graph.AddFactor(family, {seen[0] + random_.Unit(), seen[1] + random_.Unit()},
                        {camera, points.back()});
      }
    }
  }

  Summary Minimize() {
    SolverOptions options;
    options.max_num_iterations = 300;
    options.function_tolerance = 1e-15;
    options.parameter_tolerance = 0.0;
    return Solve(options, &graph);
  }

  FactorGraph graph;
  std::vector<VariableId> cameras;
  std::vector<VariableId> points;

 private:
  test::Random random_;
};

GaugeOptions OfBal(GaugeReference reference, GaugeScale scale) {
  GaugeOptions options;
  options.kind = CenterKind::kBalCamera;
  options.reference_by = reference;
  options.scale_by = scale;
  return options;
}

double CenterDistance(const SmallBundle& bundle, VariableId a, VariableId b) {
  double at_a[3], at_b[3];
  CenterOf(CenterKind::kBalCamera, bundle.graph.Values(a), at_a);
  CenterOf(CenterKind::kBalCamera, bundle.graph.Values(b), at_b);
  return std::hypot(at_b[0] - at_a[0], at_b[1] - at_a[1], at_b[2] - at_a[2]);
}

TEST(CenterDistance, JacobiansAreRight) {
  test::Random random(5);
  const PoseManifold pose_manifold;
  for (const CenterKind kind :
       {CenterKind::kPose, CenterKind::kBalCamera, CenterKind::kPlanarPose}) {
    CenterDistanceFamily family(kind);
    family.Add({0.7, 2.5});
    for (int state = 0; state < 300; ++state) {
      const auto size = static_cast<std::size_t>(family.slot(0).ambient_size);
      std::vector<double> a = random.Vector(size);
      std::vector<double> b = random.Vector(size);
      if (kind == CenterKind::kBalCamera && state % 3 == 0) {  // near no rotation at all
        for (int k = 0; k < 3; ++k) {
          a[static_cast<std::size_t>(k)] *= 1e-9;
        }
      }
      const Manifold* manifold = kind == CenterKind::kPose ? &pose_manifold : nullptr;
      const JacobianReport report =
          CheckJacobians(family, 0, {a.data(), b.data()}, {manifold, manifold});
      ASSERT_TRUE(report.ok()) << report.ToString();
    }
  }
}

TEST(CenterDistance, OfABalCameraIsThatOfItsCenter) {
  const double camera[] = {0.0, 0.0, M_PI / 2.0, 1.0, 2.0, 3.0, 500.0, 0.0, 0.0};
  double c[3];
  CenterOf(CenterKind::kBalCamera, camera, c);  // R c + t = 0, R turns x to y
  EXPECT_NEAR(c[0], -2.0, 1e-12);
  EXPECT_NEAR(c[1], 1.0, 1e-12);
  EXPECT_NEAR(c[2], -3.0, 1e-12);
}

// The minimum is the same in every gauge, and with priors the intrinsics are free.
TEST(HoldGauge, ChangesNothingButTheGauge) {
  SmallBundle free;
  const double cost = free.Minimize().final_cost;
  for (const GaugeScale scale : {GaugeScale::kDistance, GaugeScale::kCoordinate}) {
    SmallBundle held;
    HeldGauge gauge;
    ASSERT_TRUE(HoldGauge(OfBal(GaugeReference::kPrior, scale), &held.graph, &gauge).ok());
    EXPECT_EQ(gauge.reference, held.cameras[0]);
    const double before = CenterDistance(held, gauge.reference, gauge.other);
    const std::vector<double> camera(held.graph.Values(gauge.reference),
                                     held.graph.Values(gauge.reference) + 9);
    const double coordinate =
        gauge.coordinate < 0 ? 0.0 : held.graph.Values(gauge.other)[gauge.coordinate];
    const Summary summary = held.Minimize();
    EXPECT_NEAR(summary.final_cost, cost, 1e-9 * cost) << summary.FullReport();
    for (int k = 0; k < 6; ++k) {
      EXPECT_NEAR(held.graph.Values(gauge.reference)[k], camera[k], 1e-5);
    }
    EXPECT_GT(std::fabs(held.graph.Values(gauge.reference)[6] - camera[6]), 1e-3) << "focal length";
    if (scale == GaugeScale::kDistance) {
      EXPECT_NEAR(CenterDistance(held, gauge.reference, gauge.other), before, 1e-5 * before);
      EXPECT_EQ(gauge.distance, before);
    } else {
      EXPECT_NEAR(held.graph.Values(gauge.other)[gauge.coordinate], coordinate, 1e-5);
    }
  }
}

// Covariances exist once the gauge is held, and not before.
TEST(HoldGauge, MakesCovariancesExist) {
  for (const GaugeScale scale :
       {GaugeScale::kMeasured, GaugeScale::kDistance, GaugeScale::kCoordinate}) {
    for (const GaugeReference reference : {GaugeReference::kConstant, GaugeReference::kPrior}) {
      SmallBundle bundle;
      bundle.Minimize();
      ASSERT_TRUE(HoldGauge(OfBal(reference, scale), &bundle.graph).ok());
      GraphCovariance covariance;
      const Status status =
          covariance.Compute(bundle.graph, {{bundle.points[0], bundle.points[0]}});
      EXPECT_EQ(status.ok(), scale != GaugeScale::kMeasured) << status.message;
    }
  }
}

TEST(HoldGauge, HoldsTheFirstPoseOfAPoseGraph) {
  FactorGraph graph;
  const double origin[] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  const double point[] = {1.0, 2.0, 3.0};
  const auto manifold = std::make_shared<PoseManifold>();
  graph.AddVariable(point, 3, Role::kLandmark);
  graph.AddVariable(point, 3, Role::kFrame);
  const VariableId first = graph.AddVariable(origin, 7, Role::kFrame, manifold);
  graph.AddVariable(origin, 7, Role::kFrame, manifold);
  HeldGauge held;
  ASSERT_TRUE(HoldGauge(GaugeOptions(), &graph, &held).ok());
  EXPECT_EQ(held.reference, first);
  EXPECT_EQ(held.other, -1);
  EXPECT_TRUE(graph.IsConstant(first));
  EXPECT_EQ(graph.num_families(), 0);
}

// A prior on a pose is as its manifold perturbs, and there is none for others.
TEST(HoldGauge, PriorsOfPosesFollowTheirManifold) {
  const double pose[] = {1.0, 2.0, 3.0, 0.1, 0.2, 0.3, std::sqrt(1.0 - 0.14)};
  GaugeOptions options;
  options.reference_by = GaugeReference::kPrior;
  for (const std::shared_ptr<const Manifold>& manifold :
       std::vector<std::shared_ptr<const Manifold>>{std::make_shared<PoseManifold>(),
                                                    std::make_shared<LeftPoseManifold>()}) {
    FactorGraph graph;
    graph.AddVariable(pose, 7, Role::kFrame, manifold);
    HeldGauge held;
    ASSERT_TRUE(HoldGauge(options, &graph, &held).ok());
    EXPECT_TRUE(CheckJacobians(graph, held.reference_family).ok());
    EXPECT_NEAR(Solve(SolverOptions(), &graph).initial_cost, 0.0, 1e-20);
  }
  FactorGraph graph;
  graph.AddVariable(pose, 7, Role::kFrame, std::make_shared<SE3Manifold>());
  EXPECT_EQ(HoldGauge(options, &graph).code, StatusCode::kInvalidArgument);
  options.reference_by = GaugeReference::kConstant;
  EXPECT_TRUE(HoldGauge(options, &graph).ok());
}

class HoldGaugeRefuses : public testing::Test {
 protected:
  void ExpectRefused(const GaugeOptions& options, const char* words) {
    const int num_families = bundle_.graph.num_families();
    HeldGauge held;
    const Status status = HoldGauge(options, &bundle_.graph, &held);
    EXPECT_EQ(status.code, StatusCode::kInvalidArgument);
    EXPECT_NE(status.message.find(words), std::string::npos) << status.message;
    EXPECT_EQ(bundle_.graph.num_families(), num_families);
    EXPECT_FALSE(bundle_.graph.IsConstant(bundle_.cameras[0]));
    EXPECT_EQ(held.reference, -1);
  }

  SmallBundle bundle_;
  GaugeOptions options_ = OfBal(GaugeReference::kConstant, GaugeScale::kDistance);
};

TEST_F(HoldGaugeRefuses, WhatIsNoFrameOfTheKind) {
  options_.reference = bundle_.points[0];
  ExpectRefused(options_, "is no frame of this kind");
  options_.reference = 1000;
  ExpectRefused(options_, "there is no variable 1000");
  options_.reference = -1;
  options_.kind = CenterKind::kPose;
  ExpectRefused(options_, "has no frame of this kind");
}

TEST_F(HoldGaugeRefuses, AnotherThatCannotHoldTheScale) {
  options_.other = bundle_.cameras[0];
  ExpectRefused(options_, "is the reference");
  options_.other = bundle_.points[3];
  ExpectRefused(options_, "is no frame of this kind");
  options_.other = bundle_.cameras[2];
  bundle_.graph.SetConstant(bundle_.cameras[2], true);
  ExpectRefused(options_, "is constant");
  bundle_.graph.SetConstant(bundle_.cameras[2], false);
  bundle_.graph.SetValues(bundle_.cameras[2], bundle_.graph.Values(bundle_.cameras[0]));
  ExpectRefused(options_, "coincide");
}

TEST_F(HoldGaugeRefuses, ACoordinateThatHoldsNoScale) {
  options_.scale_by = GaugeScale::kCoordinate;
  options_.coordinate = 7;
  ExpectRefused(options_, "is none of the position");
  options_.coordinate = 2;
  ExpectRefused(options_, "is none of the position");
  // Moved along x of both, without a turn: y does not change with the scale.
  const double a[] = {0, 0, 0, 0, 0, -6, 500, 0, 0}, b[] = {0, 0, 0, 2, 0, -6, 500, 0, 0};
  bundle_.graph.SetValues(bundle_.cameras[0], a);
  bundle_.graph.SetValues(bundle_.cameras[1], b);
  options_.other = bundle_.cameras[1];
  options_.coordinate = 4;
  ExpectRefused(options_, "does not change when the scale does");
}

TEST_F(HoldGaugeRefuses, TheScaleInThePlane) {
  FactorGraph plane;
  const double pose[] = {0.0, 0.0, 0.0};
  plane.AddVariable(pose, 3, Role::kFrame);
  options_.kind = CenterKind::kPlanarPose;
  EXPECT_EQ(HoldGauge(options_, &plane).code, StatusCode::kInvalidArgument);
  EXPECT_FALSE(plane.IsConstant(0));
}

}  // namespace
}  // namespace inceres
