#include "trust_region/polynomial.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include <gtest/gtest.h>

namespace inceres::internal {
namespace {

using Polynomial = std::vector<double>;

// scale · Π (x − root).
Polynomial FromRoots(const std::vector<double>& roots, double scale) {
  Polynomial polynomial = {scale};
  for (const double root : roots) {
    polynomial.push_back(0.0);
    for (std::size_t k = polynomial.size() - 1; k > 0; --k) {
      polynomial[k] -= root * polynomial[k - 1];
    }
  }
  return polynomial;
}

void ExpectRoots(const Polynomial& polynomial, std::vector<double> expected, double tolerance) {
  std::vector<double> roots;
  ASSERT_TRUE(RealPartsOfRoots(polynomial, &roots));
  std::sort(roots.begin(), roots.end());
  std::sort(expected.begin(), expected.end());
  ASSERT_EQ(roots.size(), expected.size());
  for (std::size_t k = 0; k < roots.size(); ++k) {
    EXPECT_NEAR(roots[k], expected[k], tolerance * (1.0 + std::abs(expected[k])));
  }
}

TEST(Polynomial, Evaluates) {
  EXPECT_EQ(EvaluatePolynomial({2.0, -3.0, 5.0}, 4.0), 25.0);
  EXPECT_EQ(EvaluatePolynomial({7.0}, 4.0), 7.0);
}

TEST(Polynomial, RootsOfEveryDegree) {
  ExpectRoots({3.0}, {}, 0.0);
  ExpectRoots({0.0, 0.0, 3.0}, {}, 0.0);
  ExpectRoots({2.0, -3.0}, {1.5}, 1e-15);
  ExpectRoots(FromRoots({1.0, -4.0}, -2.0), {1.0, -4.0}, 1e-14);
  ExpectRoots(FromRoots({3.0, 1e-9}, 1.0), {3.0, 1e-9},
              1e-15);                                       // cancels in the textbook's formula
  ExpectRoots({0.0, 1.0, 2.0, 10.0}, {-1.0, -1.0}, 1e-15);  // −1 ± 3i
  ExpectRoots(FromRoots({1.0, 2.0, -3.0}, 5.0), {1.0, 2.0, -3.0}, 1e-12);
  ExpectRoots(FromRoots({1e-4, 1.0, 1e4, -1e3}, 1e-3), {1e-4, 1.0, 1e4, -1e3},
              1e-9);                                                   // wants balancing
  ExpectRoots({1.0, 0.0, 2.0, 0.0, 1.0}, {0.0, 0.0, 0.0, 0.0}, 1e-7);  // ±i, twice
}

TEST(Polynomial, RandomRoots) {
  std::mt19937 engine(4);
  std::uniform_real_distribution<double> uniform(-2.0, 2.0);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<double> roots(static_cast<std::size_t>(2 + trial % 4));
    for (std::size_t k = 0; k < roots.size(); ++k) {
      roots[k] = uniform(engine) + 5.0 * static_cast<double>(k);
    }
    ExpectRoots(FromRoots(roots, 1.0 + trial), roots, 1e-8);
  }
}

TEST(Polynomial, NotANumberEnds) {
  std::vector<double> roots;
  RealPartsOfRoots({1.0, std::nan(""), 2.0, 3.0, std::numeric_limits<double>::infinity()}, &roots);
  SUCCEED() << "it came back";
}

TEST(Polynomial, InterpolatesValuesAndSlopes) {
  const Polynomial cubic = {2.0, -1.0, 0.5, 3.0};
  const auto sample = [&](double x, bool value, bool slope) {
    return FunctionSample{x, EvaluatePolynomial(cubic, x), EvaluatePolynomial({6.0, -2.0, 0.5}, x),
                          value, slope};
  };
  const std::vector<std::vector<FunctionSample>> sets = {
      {sample(0.0, true, true), sample(1.5, true, true)},
      {sample(0.0, true, true), sample(1.5, true, false), sample(-1.0, true, false)},
      {sample(0.0, true, true), sample(1.5, true, false), sample(-1.0, false, true),
       sample(9.0, false, false)},
  };
  for (const auto& samples : sets) {
    const Polynomial found = Interpolate(samples);
    ASSERT_EQ(found.size(), 4U);
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_NEAR(found[k], cubic[k], 1e-13);
    }
  }
}

TEST(Polynomial, MinimumInsideAtAnEndAndNowhere) {
  const auto parabola = [](double vertex) {
    return std::vector<FunctionSample>{{0.0, vertex * vertex, -2.0 * vertex, true, true},
                                       {1.0, (1.0 - vertex) * (1.0 - vertex), 0.0, true, false}};
  };
  EXPECT_NEAR(MinimizeInterpolant(parabola(0.3), 0.001, 0.6), 0.3, 1e-14);
  EXPECT_EQ(MinimizeInterpolant(parabola(0.9), 0.001, 0.6), 0.6);
  EXPECT_EQ(MinimizeInterpolant(parabola(-0.9), 0.001, 0.6), 0.001);
  EXPECT_EQ(
      MinimizeInterpolant({{0.0, 4.0, 0.0, true, true}, {1.0, 4.0, 0.0, true, true}}, 0.2, 0.6),
      0.4)
      << "flat: the middle";
}

}  // namespace
}  // namespace inceres::internal
