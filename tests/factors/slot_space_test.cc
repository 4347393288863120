// A variable that moves in another tangent space than a family writes its Jacobians in is refused
// by name, and one that moves as it should is taken, whatever its manifold's class is.
#include "problem/slot_space.h"

#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/gauge.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/factors/landmark_position.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/check_jacobians.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/problem/manifolds.h"

namespace inceres {
namespace {

using ManifoldPointer = std::shared_ptr<const Manifold>;

// As in VINS: it moves as PoseManifold does to first order, and its Jacobian is said to be [I; 0].
class VinsPose final : public Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* moved) const override {
    return pose_.Plus(x, delta, moved);
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    for (int k = 0; k < 42; ++k) {
      jacobian[k] = k % 7 == 0 ? 1.0 : 0.0;
    }
    return true;
  }

 private:
  PoseManifold pose_;
};

// Twice as far as R³.
class Doubled final : public Manifold {
 public:
  explicit Doubled(int size) : size_(size) {}
  int AmbientSize() const override { return size_; }
  int TangentSize() const override { return size_; }
  bool Plus(const double* x, const double* delta, double* moved) const override {
    for (int k = 0; k < size_; ++k) {
      moved[k] = x[k] + 2.0 * delta[k];
    }
    return true;
  }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    for (int k = 0; k < size_ * size_; ++k) {
      jacobian[k] = k % (size_ + 1) == 0 ? 2.0 : 0.0;
    }
    return true;
  }

 private:
  int size_;
};

const ManifoldPointer kRotationBesideR3 =
    std::make_shared<ProductManifold>(std::vector<ManifoldPointer>{
        std::make_shared<EuclideanManifold>(3), std::make_shared<RotationQuaternionManifold>()});

TEST(SlotSpaces, AreToldByHowAManifoldMoves) {
  using internal::MovesIn;
  const auto holds_nothing = SubsetManifold(9, {});
  EXPECT_TRUE(MovesIn(SlotSpace::kEuclidean, holds_nothing));
  EXPECT_TRUE(MovesIn(SlotSpace::kEuclidean, EuclideanManifold(9)));
  EXPECT_FALSE(MovesIn(SlotSpace::kEuclidean, Doubled(3)));
  EXPECT_FALSE(MovesIn(SlotSpace::kEuclidean, SE2Manifold()));
  EXPECT_FALSE(MovesIn(SlotSpace::kEuclidean, SubsetManifold(9, {3}))) << "a degree less";
  EXPECT_TRUE(MovesIn(SlotSpace::kPose, PoseManifold()));
  EXPECT_TRUE(MovesIn(SlotSpace::kPose, *kRotationBesideR3));
  EXPECT_TRUE(MovesIn(SlotSpace::kPose, VinsPose()));
  EXPECT_FALSE(MovesIn(SlotSpace::kPose, LeftPoseManifold()));
  EXPECT_FALSE(MovesIn(SlotSpace::kPose, SE3Manifold()));
  EXPECT_FALSE(MovesIn(SlotSpace::kPose, SubsetManifold(7, {6})));
  EXPECT_TRUE(MovesIn(SlotSpace::kLeftPose, LeftPoseManifold()));
  EXPECT_FALSE(MovesIn(SlotSpace::kLeftPose, VinsPose()));
  EXPECT_TRUE(MovesIn(SlotSpace::kSimilarity, SimilarityManifold()));
  EXPECT_FALSE(MovesIn(SlotSpace::kSimilarity, SubsetManifold(8, {6})));
  for (const SlotSpace space :
       {SlotSpace::kEuclidean, SlotSpace::kPose, SlotSpace::kLeftPose, SlotSpace::kSimilarity}) {
    EXPECT_FALSE(MovesIn(space, SphereManifold(7))) << internal::NameOf(space);
  }
  EXPECT_TRUE(MovesIn(SlotSpace::kAny, SphereManifold(7)));
}

constexpr double kSlotPose[8] = {0.1, 0.2, 0.3, 0.5, -0.5, 0.5, 0.5, 1.2};
constexpr double kSlotValues[9] = {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0};

// One factor of the family, each of its variables on the manifold given; null: on none.
template <typename Family>
class OneFactor {
 public:
  OneFactor(std::shared_ptr<Family> family, const typename Family::Measurement& measurement,
            const std::vector<ManifoldPointer>& manifolds) {
    const auto handle = graph.AddFamily(family);
    std::vector<VariableId> variables;
    for (int s = 0; s < family->num_slots(); ++s) {
      const int size = family->slot(s).ambient_size;
      variables.push_back(graph.AddVariable(size == 7 || size == 8 ? kSlotPose : kSlotValues, size,
                                            Role::kFrame, manifolds[static_cast<std::size_t>(s)]));
    }
    graph.AddFactor(handle, measurement, variables);
  }
  FactorGraph graph;
};

template <typename Family>
std::string Refusal(std::shared_ptr<Family> family, const typename Family::Measurement& measurement,
                    const std::vector<ManifoldPointer>& manifolds) {
  return OneFactor<Family>(std::move(family), measurement, manifolds).graph.Validate().message;
}

const ManifoldPointer kNoManifold;
const ManifoldPointer kOnRight = std::make_shared<PoseManifold>();
const ManifoldPointer kOnLeft = std::make_shared<LeftPoseManifold>();
const ManifoldPointer kWrong3 = std::make_shared<Doubled>(3);
const ManifoldPointer kWrong9 = std::make_shared<Doubled>(9);

TEST(SlotSpaces, ASpatialLandmarkIsInR3) {
  const auto refusal = [](const ManifoldPointer& pose, const ManifoldPointer& landmark) {
    return Refusal(std::make_shared<SpatialLandmarkFamily>(), {}, {pose, landmark});
  };
  EXPECT_EQ(refusal(kOnRight, kNoManifold), "");
  EXPECT_EQ(refusal(kOnRight, std::make_shared<EuclideanManifold>(3)), "");
  EXPECT_EQ(refusal(kOnRight, std::make_shared<SubsetManifold>(3, std::vector<int>())), "");
  EXPECT_EQ(refusal(kOnRight, kWrong3),
            "factor 0 of spatial landmark (variables 0, 1): slot 1 takes values in Rⁿ, which need "
            "no manifold, but variable 1 is on a manifold that moves it otherwise");
  EXPECT_EQ(refusal(kOnLeft, kNoManifold),
            "factor 0 of spatial landmark (variables 0, 1): slot 0 takes a pose on PoseManifold, "
            "but variable 0 is on a manifold that moves it otherwise");
}

TEST(SlotSpaces, PriorsOnPosesTakeTheirSide) {
  const auto refusal = [](Perturbation side, const ManifoldPointer& pose) {
    return Refusal(std::make_shared<PosePriorFamily>(side), {}, {pose});
  };
  EXPECT_EQ(refusal(Perturbation::kRight, kOnRight), "");
  EXPECT_EQ(refusal(Perturbation::kRight, kRotationBesideR3), "");
  EXPECT_EQ(refusal(Perturbation::kLeft, kOnLeft), "");
  EXPECT_NE(refusal(Perturbation::kLeft, kOnRight).find("takes a pose on LeftPoseManifold"),
            std::string::npos);
  EXPECT_NE(refusal(Perturbation::kRight, std::make_shared<SE3Manifold>())
                .find("takes a pose on PoseManifold"),
            std::string::npos);
  EXPECT_NE(Refusal(std::make_shared<PositionPriorFamily>(), {}, {kOnLeft}), "");
  EXPECT_NE(Refusal(std::make_shared<SpeedBiasPriorFamily>(), {}, {kWrong9}), "");
  EXPECT_EQ(Refusal(std::make_shared<SpeedBiasPriorFamily>(), {}, {kNoManifold}), "");
}

ImuPreintegrator Preintegrated(Perturbation side) {
  ImuOptions options;
  options.conventions.perturbation = side;
  return ImuPreintegrator(options);
}

TEST(SlotSpaces, AnImuFactorTakesPosesOfItsSideAndSpeedsInR9) {
  const auto refusal = [](Perturbation side, const std::vector<ManifoldPointer>& manifolds) {
    return Refusal(std::make_shared<ImuFactorFamily>(), Preintegrated(side), manifolds);
  };
  constexpr auto kOnTheRight = Perturbation::kRight;
  constexpr auto kOnTheLeft = Perturbation::kLeft;
  EXPECT_EQ(refusal(kOnTheRight, {kOnRight, kNoManifold, kOnRight, kNoManifold}), "");
  EXPECT_EQ(refusal(kOnTheLeft, {kOnLeft, kNoManifold, kOnLeft, kNoManifold}), "");
  EXPECT_NE(refusal(kOnTheLeft, {kOnLeft, kNoManifold, kOnRight, kNoManifold})
                .find("slot 2 takes a pose on Left"),
            std::string::npos);
  EXPECT_NE(
      refusal(kOnTheRight, {kOnRight, kWrong9, kOnRight, kNoManifold}).find("slot 1 takes values"),
      std::string::npos);
}

TEST(SlotSpaces, OfTheOtherFamilies) {
  const auto similarity = std::make_shared<SimilarityManifold>();
  EXPECT_EQ(Refusal(std::make_shared<RelativeSimilarityFamily>(), {}, {similarity, similarity}),
            "");
  EXPECT_EQ(Refusal(std::make_shared<RelativePoseFamily>(), {}, {kOnRight, kOnRight}), "");
  EXPECT_NE(Refusal(std::make_shared<RelativePoseFamily>(), {}, {kOnRight, kOnLeft}), "");
  EXPECT_NE(Refusal(std::make_shared<PoseEdgeFamily>(), {}, {kOnLeft, kOnRight}), "");
  const auto one = std::make_shared<Doubled>(1);
  EXPECT_EQ(Refusal(std::make_shared<InverseDepthReprojectionFamily>(), {},
                    {kOnRight, kOnRight, kNoManifold}),
            "");
  EXPECT_NE(
      Refusal(std::make_shared<InverseDepthReprojectionFamily>(), {}, {kOnRight, kOnRight, one}),
      "");
  EXPECT_NE(Refusal(std::make_shared<BodyReprojectionFamily>(), {},
                    {kOnRight, kOnRight, kOnLeft, kNoManifold}),
            "");
}

// Where the family projects any manifold is as good.
TEST(SlotSpaces, WhoProjectsTakesAny) {
  EXPECT_EQ(Refusal(std::make_shared<CenterDistanceFamily>(CenterKind::kPose), {},
                    {kOnLeft, std::make_shared<SE3Manifold>()}),
            "");
  const auto manifold = std::make_shared<SubsetManifold>(3, std::vector<int>{1});
  EXPECT_EQ(Refusal(std::make_shared<DiagonalPriorFamily>(3, 3, 2),
                    {{1.0, 2.0, 3.0}, {1.0, 1.0, 1.0}}, {manifold}),
            "");
}

// A constant is not moved; set free by an edit it is.
TEST(SlotSpaces, OfAConstantTheManifoldDoesNotCount) {
  OneFactor<SpeedBiasPriorFamily> one(std::make_shared<SpeedBiasPriorFamily>(), {}, {kWrong9});
  one.graph.SetConstant(0, true);
  EXPECT_EQ(one.graph.Validate().message, "");
  GraphEdit edit(one.graph);
  edit.SetConstant(0, false);
  EXPECT_NE(one.graph.Apply(edit).message.find("moves it otherwise"), std::string::npos);
  EXPECT_TRUE(one.graph.IsConstant(0));
}

// A family is right in its own tangent spaces only, so there is nothing to check it by in others.
TEST(SlotSpaces, AConstantInAnotherOneHasNoJacobianToCheck) {
  constexpr double kOther[7] = {2.0, 1.0, -0.5, 0.1, -0.7, 0.1, 0.7};
  RelativePoseMeasurement measurement;
  for (int k = 0; k < 6; ++k) {
    measurement.sqrt_information[7 * k] = 1.0;
  }
  const auto check = [&](const ManifoldPointer& of_constant) {
    FactorGraph graph;
    const VariableId held = graph.AddVariable(kSlotPose, 7, Role::kFrame, of_constant);
    graph.SetConstant(held, true);
    const VariableId free = graph.AddVariable(kOther, 7, Role::kFrame, kOnRight);
    graph.AddFactor(graph.AddFamily(std::make_shared<RelativePoseFamily>()), measurement,
                    {held, free});
    const JacobianReport report = CheckJacobians(graph);
    EXPECT_TRUE(report.ok()) << report.ToString();
    return report.num_entries;
  };
  EXPECT_EQ(check(kOnRight), 72);
  EXPECT_EQ(check(kRotationBesideR3), 72);
  EXPECT_EQ(check(kOnLeft), 36);
  EXPECT_EQ(check(std::make_shared<SE3Manifold>()), 36);
}

TEST(SlotSpaces, JacobiansAreCheckedOnAManifoldThatMovesAsRn) {
  SpeedBiasPriorMeasurement measurement;
  for (int k = 0; k < 9; ++k) {
    measurement.sqrt_information[10 * k] = 1.0 + k;
  }
  const OneFactor<SpeedBiasPriorFamily> one(std::make_shared<SpeedBiasPriorFamily>(), measurement,
                                            {std::make_shared<EuclideanManifold>(9)});
  const JacobianReport report = CheckJacobians(one.graph);
  EXPECT_TRUE(report.ok()) << report.ToString();
  EXPECT_EQ(report.num_entries, 81);
}

TEST(SlotSpaces, AnEditIsRefusedByNameToo) {
  FactorGraph graph;
  const auto priors = graph.AddFamily(std::make_shared<SpeedBiasPriorFamily>());
  GraphEdit edit(graph);
  const VariableId id = edit.AddVariable(kSlotValues, 9, Role::kFrame, kWrong9);
  edit.AddFactor(priors, {}, {id});
  EXPECT_NE(graph.Apply(edit).message.find("factor 0 of speed-bias prior (variables 0): slot 0"),
            std::string::npos);
  EXPECT_EQ(graph.num_variables(), 0);
}

}  // namespace
}  // namespace inceres
