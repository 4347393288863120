// Jets themselves, without Ceres: what they are, and what is never computed.

#include "inceres/autodiff/jet.h"

#include <cmath>
#include <limits>
#include <sstream>
#include <type_traits>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/autodiff/jet_math.h"

namespace inceres {
namespace {

TEST(Jet, IsAConstantOrAVariable) {
  const Jet<3> constant(2.0);
  const Jet<3> variable(5.0, 2);
  EXPECT_EQ(constant.a, 2.0);
  EXPECT_EQ(variable.a, 5.0);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(constant.v[i], 0.0);
    EXPECT_EQ(variable.v[i], i == 2 ? 1.0 : 0.0);
  }
  EXPECT_EQ(Jet<3>().a, 0.0);  // value-initialized, as double() is
  EXPECT_EQ(Jet<3>().v[1], 0.0);
}

TEST(Jet, IsMadeOfNumbersExplicitlyOnly) {
  EXPECT_FALSE((std::is_convertible_v<double, Jet<3>>));
  EXPECT_TRUE((std::is_constructible_v<Jet<3>, double>));
  EXPECT_TRUE((std::is_constructible_v<Jet<3>, int>));
}

TEST(Jet, IsPrinted) {
  std::ostringstream out;
  out << Jet<3>(1.5, 1);
  EXPECT_EQ(out.str(), "[1.5 ; 0, 1, 0]");
}

TEST(Jet, HasTheLimitsOfDouble) {
  using Limits = std::numeric_limits<Jet<2>>;
  EXPECT_TRUE(Limits::is_specialized);
  EXPECT_EQ(Limits::epsilon().a, std::numeric_limits<double>::epsilon());
  EXPECT_EQ(Limits::lowest().a, -Limits::max().a);
  EXPECT_TRUE(std::isnan(Limits::quiet_NaN().a));
  EXPECT_EQ(Limits::infinity().v[0], 0.0);
}

TEST(Jet, DerivativesAreSetOneByOne) {
  jets::Derivatives<5> v = jets::Derivatives<5>::Zero();
  v.Set(3, 2.5);
  v.Set(4, -1.0);
  v.Set(3, 2.0);
  const jets::Derivatives<5> w = 2.0 * v - jets::Derivatives<5>::Unit(0);
  const double expected[] = {-1.0, 0.0, 0.0, 4.0, -2.0};
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(w[i], expected[i]);
  }
  EXPECT_EQ(jets::Derivatives<5>::Constant(7.0)[4], 7.0);
}

// The same by chains of copies, in arrays that change their sizes.
TEST(Jet, SurvivesContainers) {
  std::vector<Jet<9>> jets;
  for (int i = 0; i < 9; ++i) {
    jets.insert(jets.begin(), Jet<9>(i, i));
  }
  Jet<9> sum(0.0);
  for (const Jet<9>& jet : jets) {
    sum += jet * jet;
  }
  EXPECT_EQ(sum.a, 204.0);
  for (int i = 0; i < 9; ++i) {
    EXPECT_EQ(sum.v[i], 2.0 * i);
  }
}

}  // namespace
}  // namespace inceres
