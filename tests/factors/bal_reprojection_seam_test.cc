// What the solver may ask of a family: tangent maps of every kind, strides, ranges, repeated calls,
// failures.
#include <algorithm>
#include <cstring>
#include <limits>
#include <string>

#include <gtest/gtest.h>

#include "factors/bal_reference.h"
#include "inceres/factors/bal_reprojection.h"
#include "inceres/problem/factor_graph.h"
#include "inceres/problem/manifolds.h"

namespace inceres {
namespace {

constexpr double kUntouched = -77.0;

// Factors between random cameras and points, and buffers of the layout the solver uses (padded
// rows).
class BalReprojectionSeam : public testing::Test {
 protected:
  static constexpr int kCameraStride = 12;
  static constexpr int kPointStride = 4;

  void Build(int num_factors) {
    std::mt19937_64 random(30);
    for (int i = 0; i < num_factors; ++i) {
      states_.push_back(RandomBalState(random, 1.0));
      family_.Add({states_.back().x, states_.back().y});
    }
    for (const BalState& state : states_) {
      parameters_.push_back(state.camera);
      parameters_.push_back(state.point);
      maps_.push_back(&camera_identity_);
      maps_.push_back(&point_identity_);
    }
    Clear();
  }

  void Clear() {
    residuals_.assign(2 * states_.size(), kUntouched);
    J_c_.assign(2 * kCameraStride * states_.size(), kUntouched);
    J_p_.assign(2 * kPointStride * states_.size(), kUntouched);
  }

  EvaluationFailure Evaluate(int begin, int end, bool with_jacobians = true) {
    const JacobianView views[2] = {{J_c_.data(), 2 * kCameraStride, kCameraStride},
                                   {J_p_.data(), 2 * kPointStride, kPointStride}};
    return family_.Evaluate({begin, end, parameters_.data(),
                             with_jacobians ? maps_.data() : nullptr, residuals_.data(),
                             with_jacobians ? views : nullptr});
  }

  EvaluationFailure EvaluateAll(bool with_jacobians = true) {
    return Evaluate(0, static_cast<int>(states_.size()), with_jacobians);
  }

  // With the identity map first, then with `map` on the slot: the second must be the first times M.
  void ExpectProjected(int slot, const TangentMap& map, const std::vector<double>& M) {
    Clear();
    maps_[0] = &camera_identity_;
    maps_[1] = &point_identity_;
    ASSERT_FALSE(Evaluate(0, 1).failed());
    const std::vector<double> ambient = slot == 0 ? J_c_ : J_p_;
    const std::vector<double> other = slot == 0 ? J_p_ : J_c_;
    Clear();
    maps_[static_cast<std::size_t>(slot)] = &map;
    ASSERT_FALSE(Evaluate(0, 1).failed());
    const std::vector<double>& tangent = slot == 0 ? J_c_ : J_p_;
    EXPECT_EQ(slot == 0 ? J_p_ : J_c_, other);
    const int stride = slot == 0 ? kCameraStride : kPointStride;
    for (int r = 0; r < 2; ++r) {
      for (int c = 0; c < stride; ++c) {
        double expected = c < map.tangent_size ? 0.0 : kUntouched;
        for (int k = 0; c < map.tangent_size && k < map.ambient_size; ++k) {
          expected += ambient[static_cast<std::size_t>(r * stride + k)] *
                      M[static_cast<std::size_t>(k * map.tangent_size + c)];
        }
        EXPECT_NEAR(tangent[static_cast<std::size_t>(r * stride + c)], expected,
                    1e-11 * (1.0 + std::fabs(expected)));
      }
    }
  }

  BalReprojectionFamily family_;
  std::vector<BalState> states_;
  std::vector<const double*> parameters_;
  std::vector<const TangentMap*> maps_;
  std::vector<double> residuals_, J_c_, J_p_;
  const TangentMap camera_identity_{TangentMap::Kind::kIdentity, 9, 9, nullptr, nullptr};
  const TangentMap point_identity_{TangentMap::Kind::kIdentity, 3, 3, nullptr, nullptr};
};

TEST_F(BalReprojectionSeam, Sizes) {
  EXPECT_EQ(family_.residual_size(), 2);
  ASSERT_EQ(family_.num_slots(), 2);
  EXPECT_EQ(family_.slot(0).ambient_size, 9);
  EXPECT_EQ(family_.slot(0).tangent_size, 9);
  EXPECT_EQ(family_.slot(1).ambient_size, 3);
  EXPECT_EQ(family_.slot(1).tangent_size, 3);
  EXPECT_EQ(BalReprojectionFamily(6, 2).slot(0).tangent_size, 6);
  EXPECT_EQ(BalReprojectionFamily(6, 2).slot(1).tangent_size, 2);
  EXPECT_STREQ(family_.Name(), "BAL reprojection");
}

TEST_F(BalReprojectionSeam, RespectsStridesAndRanges) {
  Build(10);
  ASSERT_FALSE(Evaluate(3, 7).failed());
  for (std::size_t i = 0; i < 10; ++i) {
    const bool inside = i >= 3 && i < 7;
    EXPECT_EQ(residuals_[2 * i] != kUntouched, inside);
    for (std::size_t r = 0; r < 2; ++r) {
      for (std::size_t c = 0; c < kCameraStride; ++c) {
        EXPECT_EQ(J_c_[(2 * i + r) * kCameraStride + c] != kUntouched, inside && c < 9);
      }
      for (std::size_t c = 0; c < kPointStride; ++c) {
        EXPECT_EQ(J_p_[(2 * i + r) * kPointStride + c] != kUntouched, inside && c < 3);
      }
    }
  }
}

// Threads split ranges; the result must not depend on where.
TEST_F(BalReprojectionSeam, SameBitsForAnySplitAndForCostOnly) {
  Build(500);
  ASSERT_FALSE(EvaluateAll().failed());
  const std::vector<double> residuals = residuals_, J_c = J_c_, J_p = J_p_;
  Clear();
  for (int begin = 0; begin < 500; begin += 37) {
    ASSERT_FALSE(Evaluate(begin, std::min(begin + 37, 500)).failed());
  }
  EXPECT_EQ(residuals_, residuals);
  EXPECT_EQ(J_c_, J_c);
  EXPECT_EQ(J_p_, J_p);
  Clear();
  ASSERT_FALSE(EvaluateAll(false).failed());
  EXPECT_EQ(residuals_, residuals);
}

// 2,000 cameras share the 128 places of the rotation cache: all are evicted, and revisited in
// another order.
TEST_F(BalReprojectionSeam, CachedRotationsAreTheRightOnes) {
  Build(2000);
  ASSERT_FALSE(EvaluateAll().failed());
  const std::vector<double> residuals = residuals_;
  for (int i = 1999; i >= 0; --i) {
    ASSERT_FALSE(Evaluate(i, i + 1, false).failed());
  }
  EXPECT_EQ(residuals_, residuals);
}

TEST_F(BalReprojectionSeam, SeesParametersThatChangeBetweenCalls) {
  Build(1);
  ASSERT_FALSE(EvaluateAll().failed());
  states_[0].camera[0] += 0.5;
  ASSERT_FALSE(EvaluateAll().failed());
  double expected[2];
  ReferenceResidual(states_[0].camera, states_[0].point, states_[0].x, states_[0].y, expected);
  EXPECT_NEAR(residuals_[0], expected[0], 1e-9);
}

// A large family remembers rotations from call to call: by all bits of the angle, so that cameras
// that move in place, and a zero that changes its sign, are seen.
TEST_F(BalReprojectionSeam, LargeFamiliesHaveTheBitsOfSmallOnes) {
  Build(200);
  states_[7].camera[1] = 0.0;
  BalReprojectionFamily large;
  for (int i = 0; i < (1 << 15); ++i) {
    const BalState& state = states_[static_cast<std::size_t>(i) % states_.size()];
    large.Add({state.x, state.y});
  }
  for (int round = 0; round < 3; ++round) {
    Clear();
    ASSERT_FALSE(EvaluateAll().failed());
    const std::vector<double> residuals = residuals_, J_c = J_c_, J_p = J_p_;
    for (int repeat = 0; repeat < 2; ++repeat) {
      Clear();
      const JacobianView views[2] = {{J_c_.data(), 2 * kCameraStride, kCameraStride},
                                     {J_p_.data(), 2 * kPointStride, kPointStride}};
      ASSERT_FALSE(large
                       .Evaluate({0, static_cast<int>(states_.size()), parameters_.data(),
                                  maps_.data(), residuals_.data(), views})
                       .failed());
      const auto same = [](const std::vector<double>& a, const std::vector<double>& b) {
        return std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
      };
      EXPECT_TRUE(same(residuals_, residuals) && same(J_c_, J_c) && same(J_p_, J_p)) << round;
    }
    states_[3].camera[0] += 0.25;
    states_[7].camera[1] = -states_[7].camera[1];
  }
}

TEST_F(BalReprojectionSeam, ConstantsAreNotWritten) {
  Build(1);
  const TangentMap constant_camera{TangentMap::Kind::kConstant, 9, 9, nullptr, nullptr};
  const TangentMap constant_point{TangentMap::Kind::kConstant, 3, 3, nullptr, nullptr};
  maps_[0] = &constant_camera;
  ASSERT_FALSE(EvaluateAll().failed());
  EXPECT_EQ(J_c_, std::vector<double>(2 * kCameraStride, kUntouched));
  EXPECT_NE(J_p_[0], kUntouched);
  Clear();
  maps_[0] = &camera_identity_;
  maps_[1] = &constant_point;
  ASSERT_FALSE(EvaluateAll().failed());
  EXPECT_NE(J_c_[0], kUntouched);
  EXPECT_EQ(J_p_, std::vector<double>(2 * kPointStride, kUntouched));
  EXPECT_NE(residuals_[0], kUntouched);
}

TEST_F(BalReprojectionSeam, SelectionOnTheCamera) {
  Build(1);
  const SubsetManifold extrinsics(9, {6, 7, 8});
  std::vector<double> M(9 * 6);
  ASSERT_TRUE(extrinsics.PlusJacobian(states_[0].camera, M.data()));
  const int selection[6] = {0, 1, 2, 3, 4, 5};
  ExpectProjected(0, {TangentMap::Kind::kSelection, 9, 6, M.data(), selection}, M);
}

TEST_F(BalReprojectionSeam, DenseMapsOnCameraAndPoint) {
  Build(1);
  std::mt19937_64 random(31);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<double> M(9 * 7);
  std::generate(M.begin(), M.end(), [&] { return uniform(random); });
  ExpectProjected(0, {TangentMap::Kind::kDense, 9, 7, M.data(), nullptr}, M);
  M.resize(3 * 2);
  ExpectProjected(1, {TangentMap::Kind::kDense, 3, 2, M.data(), nullptr}, M);
}

class BalReprojectionFailure : public BalReprojectionSeam {
 protected:
  // Factor 3 is broken by the caller; both kinds of evaluation must name it, and why.
  void ExpectFailure(const std::string& word, bool cost_only_fails = true) {
    const EvaluationFailure failure = EvaluateAll(true);
    EXPECT_EQ(failure.factor, 3);
    EXPECT_NE(std::string(failure.reason).find(word), std::string::npos) << failure.reason;
    EXPECT_EQ(EvaluateAll(false).factor, cost_only_fails ? 3 : -1);
    EXPECT_FALSE(Evaluate(4, 6, true).failed());
  }

  // Camera at the origin, no rotation, no distortion.
  void MakePlain(BalState& state, double f) {
    std::fill(std::begin(state.camera), std::end(state.camera), 0.0);
    state.camera[6] = f;
  }
};

TEST_F(BalReprojectionFailure, DepthZero) {
  Build(6);
  MakePlain(states_[3], 500.0);
  states_[3].point[2] = 0.0;
  ExpectFailure("depth 0");
}

TEST_F(BalReprojectionFailure, PointAtTheCenter) {
  Build(6);
  MakePlain(states_[3], 500.0);
  std::fill(std::begin(states_[3].point), std::end(states_[3].point), 0.0);
  ExpectFailure("depth 0");
}

TEST_F(BalReprojectionFailure, NotANumberInAnyParameter) {
  Build(6);
  for (int k = 0; k < 12; ++k) {
    double& value = k < 9 ? states_[3].camera[k] : states_[3].point[k - 9];
    const double good = value;
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
      value = bad;
      // A camera at infinity along its axis sees every point at the image center, with a residual
      // that is finite.
      if (!(k == 5 && bad > 0.0)) {
        ExpectFailure("residual");
      }
    }
    value = good;
  }
}

// The residual is 1e9 px but its derivative by the point 1e310.
TEST_F(BalReprojectionFailure, JacobianThatOverflows) {
  Build(6);
  MakePlain(states_[3], 1e10);
  states_[3].point[0] = 1e-301;
  states_[3].point[1] = 0.0;
  states_[3].point[2] = -1e-300;
  ExpectFailure("Jacobian", false);
}

TEST_F(BalReprojectionFailure, NamesTheFirst) {
  Build(6);
  for (const std::size_t i : {std::size_t{3}, std::size_t{5}}) {
    MakePlain(states_[i], 500.0);
    states_[i].point[2] = 0.0;
  }
  EXPECT_EQ(EvaluateAll().factor, 3);
}

// A point behind the camera is no failure: the model is defined there.
TEST_F(BalReprojectionFailure, BehindTheCameraEvaluates) {
  Build(1);
  MakePlain(states_[0], 500.0);
  states_[0].point[2] = 5.0;
  EXPECT_FALSE(EvaluateAll().failed());
}

TEST(BalReprojectionGraph, ConnectsThroughTheGraph) {
  std::mt19937_64 random(32);
  const BalState state = RandomBalState(random, 1.0);
  FactorGraph graph;
  const VariableId camera = graph.AddVariable(state.camera, 9, Role::kFrame);
  const VariableId point = graph.AddVariable(state.point, 3, Role::kLandmark);
  const auto family = graph.AddFamily(std::make_shared<BalReprojectionFamily>());
  graph.AddFactor(family, {state.x, state.y}, {camera, point});
  EXPECT_TRUE(graph.Validate().ok());
  EXPECT_EQ(graph.DescribeFactor(family, 0), "factor 0 of BAL reprojection (variables 0, 1)");
}

}  // namespace
}  // namespace inceres
