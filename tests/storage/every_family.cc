#include "storage/every_family.h"

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/factors/bal_reprojection.h"
#include "inceres/factors/body_reprojection.h"
#include "inceres/factors/diagonal_prior.h"
#include "inceres/factors/equidistant_reprojection.h"
#include "inceres/factors/gauge.h"
#include "inceres/factors/imu_factor.h"
#include "inceres/factors/landmark_position.h"
#include "inceres/factors/planar_relative_pose.h"
#include "inceres/factors/point_reprojection.h"
#include "inceres/factors/pose_prior.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/graph_edit.h"
#include "inceres/problem/manifolds.h"
#include "inceres/solver/marginalization.h"
#include "support/random_values.h"

namespace inceres::test {
namespace {

class Maker {
 public:
  explicit Maker(FactorGraph* graph) : graph_(*graph) {}

  void Make() {
    AddPlainFamilies();
    AddVectorFamilies();
    AddOtherVariables();
    RemoveSome();
    AddLaterFamilies();
  }

 private:
  bool turns_on_the_left_ = false;

  // Values that a variable of these sizes may have, on a manifold of them.
  VariableId AddVariable(const FactorFamily::Slot& slot, SlotSpace space) {
    std::vector<double> values = random_.Vector(static_cast<std::size_t>(slot.ambient_size));
    std::shared_ptr<const Manifold> manifold;
    if (slot.ambient_size == 7 || slot.ambient_size == 8) {
      double norm = 0.0;
      for (std::size_t k = 3; k < 7; ++k) {
        norm += values[k] * values[k];
      }
      for (std::size_t k = 3; k < 7; ++k) {
        values[k] /= std::sqrt(norm);
      }
      manifold = pose_;
      if (space == SlotSpace::kLeftPose || (space == SlotSpace::kAny && turns_on_the_left_)) {
        manifold = std::make_shared<LeftPoseManifold>();
      }
      if (slot.ambient_size == 8) {
        values[7] = std::fabs(values[7]) + 0.1;
        manifold = std::make_shared<SimilarityManifold>();
      }
    } else if (slot.ambient_size != slot.tangent_size) {
      manifold = std::make_shared<SphereManifold>(slot.ambient_size);
    }
    return graph_.AddVariable(values.data(), slot.ambient_size, Role::kFrame, manifold);
  }

  std::shared_ptr<const Loss> NextLoss() { return losses_[num_factors_++ % losses_.size()]; }

  template <typename Family>
  void Connect(const FamilyHandle<Family>& handle,
               const typename Family::Measurement& measurement) {
    std::vector<VariableId> ids;
    for (int s = 0; s < handle->num_slots(); ++s) {
      ids.push_back(AddVariable(handle->slot(s), handle->Space(s)));
    }
    ASSERT_GE(graph_.AddFactor(handle, measurement, ids, NextLoss()), 0);
  }

  // Measurements that are doubles and nothing else.
  template <typename Family, typename... Arguments>
  void AddPlain(Arguments... arguments) {
    using Measurement = typename Family::Measurement;
    using Doubles = std::array<double, sizeof(Measurement) / sizeof(double)>;
    static_assert(sizeof(Measurement) == sizeof(Doubles));
    const auto handle = graph_.AddFamily(std::make_shared<Family>(arguments...));
    for (int k = 0; k < 2; ++k) {
      Measurement measurement;
      Doubles doubles;
      for (double& value : doubles) {
        value = random_.Between(0.1, 1.0);
      }
      std::memcpy(static_cast<void*>(&measurement), doubles.data(), sizeof(measurement));
      Connect(handle, measurement);
    }
  }

  void AddPlainFamilies() {
    AddPlain<BalReprojectionFamily>();
    AddPlain<BearingFamily>(LandmarkKind::kHomogeneous, Perturbation::kLeft);
    using Body = BodyReprojectionFamily;
    AddPlain<Body>(Body::TimeOffset::kEstimated, Body::Feature::kBearing,
                   Body::Views::kTwoPosesTwoCameras, Body::Error::kUnitSphere);
    AddPlain<CenterDistanceFamily>(CenterKind::kBalCamera);
    AddPlain<InverseDepthReprojectionFamily>();
    AddPlain<PlanarRelativePoseFamily>();
    AddPlain<PointReprojectionFamily>(
        PinholeCamera{400.0, 410.0, 320.0, 240.0, 0.1, 0.01, 0.001, 0.002});
    AddPlain<PosePriorFamily>(Perturbation::kLeft);
    AddPlain<SpeedBiasPriorFamily>();
    AddPlain<RelativePoseFamily>();
    AddPlain<PlanarLandmarkFamily>(PlanarSighting::kRangeBearing);
    AddPlain<SpatialLandmarkFamily>();
    AddPlain<PositionPriorFamily>();
    AddPlain<PoseEdgeFamily>(PoseErrorConvention::kG2o);
    AddPlain<RelativeSimilarityFamily>(SimilarityErrorConvention::kLogarithm);
    AddPlain<StereoReprojectionFamily>(StereoCamera{400.0, 410.0, 320.0, 240.0, 0.2},
                                       LandmarkKind::kHomogeneous);
  }

  void AddVectorFamilies() {
    const auto diagonal = graph_.AddFamily(std::make_shared<DiagonalPriorFamily>(2, 4, 3));
    Connect(diagonal, {{1.0, 2.0}, {3.0, 4.0}});
    Connect(diagonal, {{5.0, 6.0}, {7.0, 8.0}});
    LinearPrior prior;
    prior.blocks = {{{0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0}, pose_, 6}, {{1.0, 2.0}, nullptr, 2}};
    prior.J = random_.Vector(64);
    prior.e0 = random_.Vector(8);
    const auto linear = graph_.AddFamily(std::make_shared<LinearPriorFamily>(prior));
    Connect(linear, prior);
    graph_.AddFamily(std::make_shared<LinearPriorFamily>(prior));  // without a prior
    AddImu();
  }

  void AddImu() {
    ImuOptions options;
    options.conventions = ImuConventions::Okvis();
    turns_on_the_left_ = true;  // which an empty family does not know yet
    options.max_speed_change = std::numeric_limits<double>::infinity();
    std::vector<ImuSample> samples(6);
    for (std::size_t k = 0; k < samples.size(); ++k) {
      samples[k].time = 0.01 * static_cast<double>(k);
      for (int axis = 0; axis < 3; ++axis) {
        samples[k].gyr[axis] = random_.Unit();
        samples[k].acc[axis] = 9.0 * random_.Unit();
      }
    }
    const double gyr_bias[] = {0.01, 0.02, 0.03}, acc_bias[] = {0.1, 0.2, 0.3};
    ImuPreintegrator imu(options);
    ASSERT_TRUE(imu.Integrate(samples, gyr_bias, acc_bias).ok());
    const auto family = graph_.AddFamily(std::make_shared<ImuFactorFamily>());
    Connect(family, imu);
    Connect(family, ImuPreintegrator());  // of nothing
  }

  void AddOtherVariables() {
    const std::vector<std::shared_ptr<const Manifold>> manifolds = {
        std::make_shared<EuclideanManifold>(2),
        std::make_shared<SubsetManifold>(4, std::vector<int>{1, 3}),
        std::make_shared<QuaternionManifold>(),
        std::make_shared<EigenQuaternionManifold>(),
        std::make_shared<RotationQuaternionManifold>(),
        std::make_shared<LeftPoseManifold>(),
        std::make_shared<SE3Manifold>(),
        std::make_shared<SE2Manifold>(),
        std::make_shared<SimilarityManifold>(),
        std::make_shared<ProductManifold>(std::vector<std::shared_ptr<const Manifold>>{
            std::make_shared<EuclideanManifold>(1), std::make_shared<SphereManifold>(3)})};
    for (const std::shared_ptr<const Manifold>& manifold : manifolds) {
      const std::vector<double> values(static_cast<std::size_t>(manifold->AmbientSize()), 0.5);
      graph_.AddVariable(values.data(), manifold->AmbientSize(), Role::kFrame, manifold);
    }
    static const double kBorrowed[] = {7.0, 8.0, 9.0};
    graph_.AddBorrowedConstant(kBorrowed, 3);
    const double point[] = {1.0, 2.0, 3.0};
    const double low[] = {0.0, -HUGE_VAL, 0.0}, high[] = {2.0, 3.0, HUGE_VAL};
    const VariableId bounded = graph_.AddVariable(point, 3, Role::kLandmark);
    graph_.SetBounds(bounded, low, high);
    const VariableId pinned = graph_.AddVariable(point, 3, Role::kFrame);
    const double elsewhere[] = {1.5, 2.5, 3.5};
    graph_.PinLinearization(pinned, elsewhere);
    graph_.SetConstant(graph_.AddVariable(point, 3, Role::kLandmark), true);
    graph_.SetEliminationGroup(pinned, 7);
    graph_.SetEliminationGroup(bounded, 2);
  }

  void RemoveSome() {
    static const double kBorrowed[] = {1.0, 2.0, 3.0};
    const double point[] = {1.0, 2.0, 3.0};
    GraphEdit add(graph_);
    std::vector<VariableId> comers;
    for (int k = 0; k < 4; ++k) {
      comers.push_back(add.AddVariable(point, 3, Role::kLandmark));
    }
    comers.push_back(add.AddBorrowedConstant(kBorrowed, 3));
    ASSERT_TRUE(graph_.Apply(add).ok());
    GraphEdit remove(graph_);
    remove.RemoveFactor({0, 0});
    remove.RemoveFactor({5, 1});
    remove.RemoveFactor({5, 0});
    for (const VariableId id : {comers[2], comers[0], comers[4], comers[3]}) {
      remove.RemoveVariable(id);
    }
    ASSERT_TRUE(graph_.Apply(remove).ok());
  }

  // kNumLaterFamilies. Everything before them stays what it is in the file.
  void AddLaterFamilies() {
    AddPlain<EquidistantReprojectionFamily>(
        EquidistantCamera{285.0, 286.0, 424.0, 400.0, -0.007, 0.043, -0.041, 0.0075},
        LandmarkKind::kHomogeneous, Perturbation::kLeft);
  }

  FactorGraph& graph_;
  Random random_{11};
  const std::shared_ptr<const Manifold> pose_ = std::make_shared<PoseManifold>();
  const std::vector<std::shared_ptr<const Loss>> losses_ = {
      nullptr,
      std::make_shared<HuberLoss>(0.3),
      std::make_shared<SoftLOneLoss>(0.3),
      std::make_shared<CauchyLoss>(0.7),
      std::make_shared<ArctanLoss>(1.3),
      std::make_shared<TolerantLoss>(1.0, 0.2),
      std::make_shared<TukeyLoss>(2.0),
      std::make_shared<ScaledLoss>(std::make_shared<HuberLoss>(0.1), 3.0),
      std::make_shared<ComposedLoss>(std::make_shared<HuberLoss>(0.1), nullptr)};
  std::size_t num_factors_ = 0;
};

}  // namespace

void MakeEverything(FactorGraph* graph) {
  Maker(graph).Make();
}

}  // namespace inceres::test
