// One suite of laws for every built-in manifold.
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

#include "problem/manifold_cases.h"

namespace inceres {
namespace {

constexpr int kNumStates = 1000;

class ManifoldLaws : public testing::TestWithParam<ManifoldCase> {
 protected:
  const Manifold& manifold() const { return *GetParam().manifold; }
  std::vector<double> Plus(const std::vector<double>& x, const std::vector<double>& delta) const {
    std::vector<double> result(x.size());
    EXPECT_TRUE(manifold().Plus(x.data(), delta.data(), result.data()));
    return result;
  }
  std::vector<double> Jacobian(const std::vector<double>& x) const {
    // Filled beforehand, so that a forgotten entry shows.
    std::vector<double> J(x.size() * static_cast<std::size_t>(manifold().TangentSize()), 1e30);
    EXPECT_TRUE(manifold().PlusJacobian(x.data(), J.data()));
    return J;
  }
  std::vector<double> RandomDelta(double limit) {
    return RandomVector(random_, manifold().TangentSize(), limit);
  }

  Random random_{20240607};
};

TEST_P(ManifoldLaws, Sizes) {
  EXPECT_EQ(manifold().AmbientSize(), GetParam().ambient_size);
  EXPECT_EQ(manifold().TangentSize(), GetParam().tangent_size);
}

TEST_P(ManifoldLaws, PlusZeroIsTheSamePoint) {
  for (int k = 0; k < kNumStates; ++k) {
    const std::vector<double> x = GetParam().random_point(random_);
    const std::vector<double> zero(static_cast<std::size_t>(manifold().TangentSize()), 0.0);
    EXPECT_EQ(Plus(x, zero), x);
  }
}

TEST_P(ManifoldLaws, PlusMayOverwriteItsInput) {
  for (int k = 0; k < 20; ++k) {
    std::vector<double> x = GetParam().random_point(random_);
    const std::vector<double> delta = RandomDelta(1.0);
    const std::vector<double> expected = Plus(x, delta);
    ASSERT_TRUE(manifold().Plus(x.data(), delta.data(), x.data()));
    EXPECT_EQ(x, expected);
  }
}

TEST_P(ManifoldLaws, PlusJacobianIsTheDerivativeOfPlus) {
  constexpr double kStep = 1e-5;  // central difference: error about kStep²/6 + 1e-16/kStep
  const int d = manifold().TangentSize();
  for (int k = 0; k < kNumStates; ++k) {
    const std::vector<double> x = GetParam().random_point(random_);
    const std::vector<double> J = Jacobian(x);
    for (int c = 0; c < d; ++c) {
      std::vector<double> delta(static_cast<std::size_t>(d), 0.0);
      delta[static_cast<std::size_t>(c)] = kStep;
      const std::vector<double> forward = Plus(x, delta);
      delta[static_cast<std::size_t>(c)] = -kStep;
      const std::vector<double> backward = Plus(x, delta);
      for (std::size_t r = 0; r < x.size(); ++r) {
        const double numeric = (forward[r] - backward[r]) / (2.0 * kStep);
        ASSERT_NEAR(J[r * static_cast<std::size_t>(d) + static_cast<std::size_t>(c)], numeric, 1e-9)
            << "row " << r << ", column " << c << ", state " << k;
      }
    }
  }
}

// For steps so small that their square vanishes, x ⊞ δ = x + J δ to the last bits, whatever branch
// the formulas take.
TEST_P(ManifoldLaws, TinyStepsAreLinear) {
  const auto d = static_cast<std::size_t>(manifold().TangentSize());
  for (const double limit : {1e-9, 1e-12, 1e-100, 1e-160, 1e-300}) {
    for (int k = 0; k < 20; ++k) {
      const std::vector<double> x = GetParam().random_point(random_);
      const std::vector<double> delta = RandomDelta(limit);
      const std::vector<double> J = Jacobian(x);
      const std::vector<double> moved = Plus(x, delta);
      for (std::size_t r = 0; r < x.size(); ++r) {
        double linear = x[r];
        for (std::size_t c = 0; c < d; ++c) {
          linear += J[r * d + c] * delta[c];
        }
        ASSERT_NEAR(moved[r], linear, 4e-15) << "step " << limit;
      }
    }
  }
}

// Along one direction, from 1e-6 to 2: the distance traveled per unit of step changes no faster
// than curvature allows, so a jump between a Taylor branch and its closed form shows.
TEST_P(ManifoldLaws, StepsAreSmoothAcrossTheBranches) {
  for (int k = 0; k < 100; ++k) {
    const std::vector<double> x = GetParam().random_point(random_);
    const std::vector<double> direction = RandomDelta(1.0);
    double previous = -1.0;
    for (double scale = 1e-6; scale < 2.0; scale *= 1.1) {
      std::vector<double> delta = direction;
      for (double& value : delta) {
        value *= scale;
      }
      const std::vector<double> moved = Plus(x, delta);
      double distance = 0.0;
      for (std::size_t r = 0; r < x.size(); ++r) {
        distance = std::hypot(distance, moved[r] - x[r]);
      }
      const double per_unit = distance / scale;
      if (previous >= 0.0) {
        ASSERT_NEAR(per_unit, previous, 1e-8 + 0.5 * scale) << "scale " << scale;
      }
      previous = per_unit;
    }
  }
}

// δ ↦ x ⊞ δ ↦ δ, up to turns just short of half a circle (the left quaternions turn by twice ‖δ‖).
TEST_P(ManifoldLaws, MinusUndoesPlus) {
  const auto d = static_cast<std::size_t>(manifold().TangentSize());
  for (const double limit : {1e-300, 1e-160, 1e-9, 1e-3, 0.1, 0.85}) {
    for (int k = 0; k < 100; ++k) {
      const std::vector<double> x = GetParam().random_point(random_);
      const std::vector<double> delta = RandomDelta(limit);
      const std::vector<double> y = Plus(x, delta);
      std::vector<double> found(d, 1e30);
      ASSERT_TRUE(manifold().Minus(y.data(), x.data(), found.data()));
      for (std::size_t c = 0; c < d; ++c) {
        ASSERT_NEAR(found[c], delta[c], 2e-14) << "limit " << limit << ", entry " << c;
      }
    }
  }
}

TEST_P(ManifoldLaws, MinusOfTheSamePointIsZero) {
  for (int k = 0; k < 100; ++k) {
    const std::vector<double> x = GetParam().random_point(random_);
    std::vector<double> found(static_cast<std::size_t>(manifold().TangentSize()), 1e30);
    ASSERT_TRUE(manifold().Minus(x.data(), x.data(), found.data()));
    for (const double entry : found) {
      ASSERT_NEAR(entry, 0.0, 1e-15);
    }
  }
}

// What a manifold of a user's own inherits finds the same as the closed forms.
TEST_P(ManifoldLaws, MinusWithoutAClosedForm) {
  const auto d = static_cast<std::size_t>(manifold().TangentSize());
  for (int k = 0; k < 100; ++k) {
    const std::vector<double> x = GetParam().random_point(random_);
    const std::vector<double> delta = RandomDelta(k % 2 == 0 ? 0.5 : 1e-4);
    const std::vector<double> y = Plus(x, delta);
    std::vector<double> found(d, 1e30);
    ASSERT_TRUE(manifold().Manifold::Minus(y.data(), x.data(), found.data())) << k;
    for (std::size_t c = 0; c < d; ++c) {
      ASSERT_NEAR(found[c], delta[c], 1e-12) << "entry " << c;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(BuiltIn, ManifoldLaws, testing::ValuesIn(AllManifolds()),
                         [](const testing::TestParamInfo<ManifoldCase>& instance) {
                           return instance.param.name;
                         });

TEST(PoseManifolds, MinusTakesBothSignsOfAQuaternionForOne) {
  const double x[7] = {1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8};
  const double y[7] = {1.5, 2.0, 3.0, 0.0, 0.0, -0.6, -0.8};
  double delta[6];
  for (const std::shared_ptr<const Manifold>& manifold :
       {std::shared_ptr<const Manifold>(std::make_shared<PoseManifold>()),
        std::shared_ptr<const Manifold>(std::make_shared<SE3Manifold>())}) {
    ASSERT_TRUE(manifold->Minus(y, x, delta));
    EXPECT_NEAR(std::hypot(delta[3], delta[4], delta[5]), 0.0, 1e-15);
    EXPECT_NEAR(std::hypot(delta[0], delta[1], delta[2]), 0.5, 1e-15);
  }
}

TEST(SphereManifold, MinusFailsAtTheAntipode) {
  const SphereManifold manifold(3);
  const double x[3] = {0.0, 0.0, 2.0};
  const double antipode[3] = {0.0, 0.0, -2.0};
  double delta[2];
  EXPECT_FALSE(manifold.Minus(antipode, x, delta));
}

TEST(SubsetManifold, AllConstantHasNoTangent) {
  const SubsetManifold manifold(2, {0, 1});
  EXPECT_EQ(manifold.TangentSize(), 0);
}

TEST(SubsetManifold, IndexOutsideFails) {
  for (const int index : {-1, 3}) {
    const SubsetManifold manifold(3, {index});
    const double x[3] = {1.0, 2.0, 3.0};
    const double delta[3] = {};
    double result[9];
    EXPECT_FALSE(manifold.Plus(x, delta, result)) << index;
    EXPECT_FALSE(manifold.PlusJacobian(x, result)) << index;
  }
}

TEST(ProductManifold, NullComponentFails) {
  const ProductManifold manifold({std::make_shared<EuclideanManifold>(2), nullptr});
  const double x[2] = {1.0, 2.0};
  const double delta[2] = {};
  double result[4];
  EXPECT_EQ(manifold.AmbientSize(), 2);
  EXPECT_FALSE(manifold.Plus(x, delta, result));
  EXPECT_FALSE(manifold.PlusJacobian(x, result));
}

// No variable has as many values as these have together.
TEST(ProductManifold, SizesDoNotOverflow) {
  const auto large = std::make_shared<EuclideanManifold>(1 << 30);
  const ProductManifold manifold({large, large, large});
  EXPECT_EQ(manifold.AmbientSize(), std::numeric_limits<int>::max());
  EXPECT_EQ(manifold.TangentSize(), std::numeric_limits<int>::max());
}

// Undefined wherever a component is.
TEST(ProductManifold, PassesFailureOn) {
  const ProductManifold manifold(
      {std::make_shared<EuclideanManifold>(1), std::make_shared<SphereManifold>(3)});
  const double x[4] = {1.0, 0.0, 0.0, 0.0};
  const double delta[3] = {0.1, 0.1, 0.1};
  double result[12];
  EXPECT_FALSE(manifold.Plus(x, delta, result));
  EXPECT_FALSE(manifold.PlusJacobian(x, result));
}

TEST(SphereManifold, UndefinedAtZero) {
  const SphereManifold manifold(3);
  const double x[3] = {};
  const double delta[2] = {0.1, 0.1};
  double result[6];
  EXPECT_FALSE(manifold.Plus(x, delta, result));
  EXPECT_FALSE(manifold.PlusJacobian(x, result));
}

}  // namespace
}  // namespace inceres
