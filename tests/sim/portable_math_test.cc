#include "tools/sim/portable_math.h"

#include <cmath>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

TEST(PortableMath, AgreesWithTheLibrary) {
  Random random(3, 0);
  for (int i = 0; i < 20000; ++i) {
    const double x = random.Uniform(-1.0, 1.0) * (i % 2 == 0 ? 4.0 : 5000.0),
                 y = random.Uniform(-4.0, 4.0);
    EXPECT_NEAR(PortableSin(x), std::sin(x), 2e-15) << x;
    EXPECT_NEAR(PortableCos(x), std::cos(x), 2e-15) << x;
    EXPECT_NEAR(PortableAtan2(y, x), std::atan2(y, x), 2e-15) << y << " " << x;
    const double positive = std::abs(x) + 1e-300;
    EXPECT_NEAR(PortableLog(positive), std::log(positive),
                1e-15 * (1.0 + std::abs(std::log(positive))))
        << positive;
  }
}

TEST(PortableMath, SpecialArguments) {
  EXPECT_EQ(PortableSin(0.0), 0.0);
  EXPECT_EQ(PortableCos(0.0), 1.0);
  EXPECT_EQ(PortableLog(1.0), 0.0);
  EXPECT_EQ(PortableAtan2(0.0, 0.0), 0.0);
  EXPECT_DOUBLE_EQ(PortableAtan2(1.0, 0.0), std::acos(0.0));
  EXPECT_DOUBLE_EQ(PortableAtan2(0.0, -1.0), std::acos(-1.0));
  EXPECT_DOUBLE_EQ(PortableAtan2(-2.0, 0.0), -std::acos(0.0));
  EXPECT_NEAR(PortableLog(1e-300), std::log(1e-300), 1e-12);
}

TEST(PortableMath, RotationsGoThereAndBack) {
  Random random(4, 0);
  for (int i = 0; i < 2000; ++i) {
    // Near zero, ordinary, and near half a turn.
    const double size = i % 3 == 0 ? 1e-9 : i % 3 == 1 ? 1.5 : 3.1415;
    Vector3 a = random.Normal3(1.0);
    a = (size / std::sqrt(Dot(a, a))) * a;
    const Rotation R = Rotation::FromAngleAxis(a);
    const Vector3 back = R.ToAngleAxis();
    const Vector3 x = random.Normal3(1.0);
    const Vector3 same = R.Inverse() * (R * x);
    const Vector3 twice = (R * R) * x, step = R * (R * x);
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(back[k], a[k], 1e-14 + 1e-14 * size);
      EXPECT_NEAR(same[k], x[k], 1e-13);
      EXPECT_NEAR(twice[k], step[k], 1e-13);
    }
  }
  const Vector3 x = Rotation::AboutAxis(2, std::acos(0.0)) * Vector3{1.0, 0.0, 0.0};
  EXPECT_NEAR(x[0], 0.0, 1e-15);
  EXPECT_NEAR(x[1], 1.0, 1e-15);
}

TEST(PortableRandom, MomentsAndRange) {
  Random random(1, 0);
  double sum = 0.0, squares = 0.0, fourth = 0.0;
  constexpr int kSamples = 200000;
  for (int i = 0; i < kSamples; ++i) {
    const double x = random.Normal();
    sum += x;
    squares += x * x;
    fourth += x * x * x * x;
    const double u = random.Uniform();
    ASSERT_TRUE(u >= 0.0 && u < 1.0);
    ASSERT_TRUE(random.Below(7) < 7);
  }
  EXPECT_NEAR(sum / kSamples, 0.0, 0.01);
  EXPECT_NEAR(squares / kSamples, 1.0, 0.02);
  EXPECT_NEAR(fourth / kSamples, 3.0, 0.1);
}

TEST(PortableRandom, StreamsDiffer) {
  Random a(1, 0), b(1, 1), c(1, 0);
  const double first = a.Uniform();
  EXPECT_NE(first, b.Uniform());
  EXPECT_EQ(first, c.Uniform());
}

}  // namespace
}  // namespace inceres::internal
