// The manifolds that share a name with one of Ceres's are the same.
#include <ceres/manifold.h>
#include <gtest/gtest.h>

#include "problem/manifold_cases.h"

namespace inceres {
namespace {

void ExpectSame(const Manifold& ours, const ceres::Manifold& theirs,
                const std::function<std::vector<double>(Random&)>& point) {
  Random random(12);
  ASSERT_EQ(ours.AmbientSize(), theirs.AmbientSize());
  ASSERT_EQ(ours.TangentSize(), theirs.TangentSize());
  for (int k = 0; k < 1000; ++k) {
    const std::vector<double> x = point(random);
    const std::vector<double> delta =
        RandomVector(random, ours.TangentSize(), k % 2 == 0 ? 2.0 : 1e-8);
    std::vector<double> moved(x.size()), expected(x.size());
    ASSERT_TRUE(ours.Plus(x.data(), delta.data(), moved.data()));
    ASSERT_TRUE(theirs.Plus(x.data(), delta.data(), expected.data()));
    std::vector<double> J(x.size() * delta.size()), J_expected(x.size() * delta.size());
    ASSERT_TRUE(ours.PlusJacobian(x.data(), J.data()));
    ASSERT_TRUE(theirs.PlusJacobian(x.data(), J_expected.data()));
    for (std::size_t r = 0; r < x.size(); ++r) {
      ASSERT_NEAR(moved[r], expected[r], 1e-15 * 4.0);
    }
    for (std::size_t e = 0; e < J.size(); ++e) {
      ASSERT_NEAR(J[e], J_expected[e], 1e-15) << "entry " << e;
    }
  }
}

TEST(ManifoldsAgainstCeres, Quaternion) {
  ExpectSame(QuaternionManifold(), ceres::QuaternionManifold(), RandomQuaternion);
}

TEST(ManifoldsAgainstCeres, EigenQuaternion) {
  ExpectSame(EigenQuaternionManifold(), ceres::EigenQuaternionManifold(), RandomQuaternion);
}

TEST(ManifoldsAgainstCeres, Subset) {
  ExpectSame(SubsetManifold(5, {1, 3}), ceres::SubsetManifold(5, {1, 3}),
             [](Random& random) { return RandomVector(random, 5); });
}

}  // namespace
}  // namespace inceres
