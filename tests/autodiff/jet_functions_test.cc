// Every function of a Jet is the one that ceres::Jet has, special cases included.

#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "autodiff/compare_jets.h"
#include "support/random_values.h"

namespace inceres {
namespace {

constexpr int kN = 5;
using Ours = Jet<kN>;
using Stock = ceres::Jet<double, kN>;

Ours RandomJet(double value, test::Random* random) {
  Ours jet(value);
  for (int i = 0; i < kN; ++i) {
    jet.v.Set(i, random->Unit());
  }
  return jet;
}

// Values that functions have special cases at, and a hundred others.
std::vector<double> JetValues(test::Random* random) {
  std::vector<double> values = {0.0,
                                -0.0,
                                1.0,
                                -1.0,
                                2.0,
                                -2.0,
                                0.5,
                                1e-300,
                                1e300,
                                std::numeric_limits<double>::infinity(),
                                std::numeric_limits<double>::quiet_NaN()};
  for (int k = 0; k < 100; ++k) {
    values.push_back(random->Between(-3.0, 3.0));
  }
  return values;
}

#define INCERES_EXPECT_SAME_UNARY(name) \
  test::ExpectSame(Ours(name(x)), Stock(name(test::ToStock(x))), #name)
#define INCERES_EXPECT_SAME_BINARY(name) \
  test::ExpectSame(Ours(name(x, y)), Stock(name(test::ToStock(x), test::ToStock(y))), #name)

TEST(JetFunctions, OfOneJetAreThoseOfCeres) {
  test::Random random(11);
  for (const double value : JetValues(&random)) {
    SCOPED_TRACE(value);
    const Ours x = RandomJet(value, &random);
    INCERES_EXPECT_SAME_UNARY(-);
    INCERES_EXPECT_SAME_UNARY(+);
    INCERES_EXPECT_SAME_UNARY(abs);
    INCERES_EXPECT_SAME_UNARY(acos);
    INCERES_EXPECT_SAME_UNARY(asin);
    INCERES_EXPECT_SAME_UNARY(atan);
    INCERES_EXPECT_SAME_UNARY(cbrt);
    INCERES_EXPECT_SAME_UNARY(ceil);
    INCERES_EXPECT_SAME_UNARY(cos);
    INCERES_EXPECT_SAME_UNARY(cosh);
    INCERES_EXPECT_SAME_UNARY(erf);
    INCERES_EXPECT_SAME_UNARY(erfc);
    INCERES_EXPECT_SAME_UNARY(exp);
    INCERES_EXPECT_SAME_UNARY(exp2);
    INCERES_EXPECT_SAME_UNARY(expm1);
    INCERES_EXPECT_SAME_UNARY(floor);
    INCERES_EXPECT_SAME_UNARY(log);
    INCERES_EXPECT_SAME_UNARY(log10);
    INCERES_EXPECT_SAME_UNARY(log1p);
    INCERES_EXPECT_SAME_UNARY(log2);
    INCERES_EXPECT_SAME_UNARY(norm);
    INCERES_EXPECT_SAME_UNARY(sin);
    INCERES_EXPECT_SAME_UNARY(sinh);
    INCERES_EXPECT_SAME_UNARY(sqrt);
    INCERES_EXPECT_SAME_UNARY(tan);
    INCERES_EXPECT_SAME_UNARY(tanh);
    INCERES_EXPECT_SAME_UNARY(BesselJ0);
    INCERES_EXPECT_SAME_UNARY(BesselJ1);
    test::ExpectSame(BesselJn(3, x), BesselJn(3, test::ToStock(x)), "BesselJn");
  }
}

TEST(JetFunctions, OfTwoJetsAreThoseOfCeres) {
  test::Random random(12);
  for (const double x_value : JetValues(&random)) {
    for (const double y_value : {0.0, -0.0, 1.0, 2.0, -1.0, -3.0, 0.7, -1.3}) {
      SCOPED_TRACE(::testing::Message() << x_value << ", " << y_value);
      const Ours x = RandomJet(x_value, &random);
      const Ours y = RandomJet(y_value, &random);
      INCERES_EXPECT_SAME_BINARY(operator+);
      INCERES_EXPECT_SAME_BINARY(operator-);
      INCERES_EXPECT_SAME_BINARY(operator*);
      INCERES_EXPECT_SAME_BINARY(operator/);
      INCERES_EXPECT_SAME_BINARY(atan2);
      INCERES_EXPECT_SAME_BINARY(copysign);
      INCERES_EXPECT_SAME_BINARY(fdim);
      INCERES_EXPECT_SAME_BINARY(fmax);
      INCERES_EXPECT_SAME_BINARY(fmin);
      INCERES_EXPECT_SAME_BINARY(hypot);
      INCERES_EXPECT_SAME_BINARY(pow);
      const Ours z = RandomJet(0.3, &random);
      test::ExpectSame(fma(x, y, z), fma(test::ToStock(x), test::ToStock(y), test::ToStock(z)),
                       "fma");
      test::ExpectSame(hypot(x, y, z), hypot(test::ToStock(x), test::ToStock(y), test::ToStock(z)),
                       "hypot");
    }
  }
}

TEST(JetFunctions, OfAConstantPowerAreThoseOfCeres) {
  test::Random random(13);
  for (const double x_value : JetValues(&random)) {
    for (const double p : {0.0, 1.0, 2.0, -1.0, 0.5, -2.5}) {
      SCOPED_TRACE(::testing::Message() << x_value << ", " << p);
      const Ours x = RandomJet(x_value, &random);
      test::ExpectSame(pow(x, p), pow(test::ToStock(x), p), "pow(Jet, double)");
      test::ExpectSame(pow(p, x), pow(p, test::ToStock(x)), "pow(double, Jet)");
      // An exponent whose derivatives are zero, which the compiler does not see (of one that it
      // sees 0 · NaN is left out): the derivative of a negative base is then defined.
      Ours constant(p);
      for (int i = 0; i < kN; ++i) {
        constant.v.Set(i, 0.0);
      }
      test::ExpectSame(pow(x, constant), pow(test::ToStock(x), test::ToStock(constant)),
                       "pow(Jet, constant Jet)");
    }
  }
}

// With numbers on either side; doubles and ints.
TEST(JetFunctions, MixedOperationsAreThoseOfCeres) {
  test::Random random(14);
  for (const double value : JetValues(&random)) {
    SCOPED_TRACE(value);
    const Ours x = RandomJet(value, &random);
    const Stock stock = test::ToStock(x);
    test::ExpectSame(x + 2.5, stock + 2.5, "x + s");
    test::ExpectSame(2.5 + x, 2.5 + stock, "s + x");
    test::ExpectSame(x - 2.5, stock - 2.5, "x - s");
    test::ExpectSame(2.5 - x, 2.5 - stock, "s - x");
    test::ExpectSame(x * 2.5, stock * 2.5, "x * s");
    test::ExpectSame(2.5 * x, 2.5 * stock, "s * x");
    test::ExpectSame(x / 2.5, stock / 2.5, "x / s");
    test::ExpectSame(2.5 / x, 2.5 / stock, "s / x");
    test::ExpectSame(2 * x, 2.0 * stock, "int * x");
    test::ExpectSame(fmax(x, 0.3), fmax(stock, 0.3), "fmax");
    test::ExpectSame(fmin(0.3, x), fmin(0.3, stock), "fmin");
    test::ExpectSame(fdim(x, 0.3), fdim(stock, 0.3), "fdim");
    Ours ours_sum = x;
    Stock stock_sum = stock;
    ours_sum += x, ours_sum *= x, ours_sum -= 0.5, ours_sum /= 3.0, ours_sum /= x, ours_sum -= x;
    stock_sum += stock, stock_sum *= stock, stock_sum -= 0.5, stock_sum /= 3.0, stock_sum /= stock;
    stock_sum -= stock;
    test::ExpectSame(ours_sum, stock_sum, "compound");
  }
}

TEST(JetFunctions, ComparisonsLookAtValuesOnly) {
  test::Random random(15);
  for (const double a : JetValues(&random)) {
    for (const double b : {a, 0.0, 1.0, std::numeric_limits<double>::quiet_NaN()}) {
      SCOPED_TRACE(::testing::Message() << a << ", " << b);
      const Ours x = RandomJet(a, &random);
      const Ours y = RandomJet(b, &random);
      EXPECT_EQ(x < y, a < b);
      EXPECT_EQ(x <= b, a <= b);
      EXPECT_EQ(a > y, a > b);
      EXPECT_EQ(x >= y, a >= b);
      EXPECT_EQ(x == b, a == b);
      EXPECT_EQ(a != y, a != b);
      EXPECT_EQ(isgreater(x, y), std::isgreater(a, b));
      EXPECT_EQ(isgreaterequal(x, b), std::isgreaterequal(a, b));
      EXPECT_EQ(isless(a, y), std::isless(a, b));
      EXPECT_EQ(islessequal(x, y), std::islessequal(a, b));
      EXPECT_EQ(islessgreater(x, y), std::islessgreater(a, b));
      EXPECT_EQ(isunordered(x, y), std::isunordered(a, b));
    }
    const Ours x = RandomJet(a, &random);
    EXPECT_EQ(isfinite(x), std::isfinite(a));
    EXPECT_EQ(isinf(x), std::isinf(a));
    EXPECT_EQ(isnan(x), std::isnan(a));
    EXPECT_EQ(isnormal(x), std::isnormal(a));
    EXPECT_EQ(signbit(x), std::signbit(a));
    EXPECT_EQ(fpclassify(x), std::fpclassify(a));
  }
}

}  // namespace
}  // namespace inceres
