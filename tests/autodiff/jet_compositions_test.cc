// Random compositions of operations, in which nothing is known when the program is compiled: the
// same as ceres::Jet, for few derivatives, for many, and for so many that they are loops.

#include <array>

#include <gtest/gtest.h>

#include "autodiff/compare_jets.h"
#include "support/random_values.h"

namespace inceres {
namespace {

constexpr int kNumValues = 8;

// One operation on two of the values, in place of the first. All keep values of moderate size.
template <typename T>
T ApplyOperation(int operation, const T& x, const T& y) {
  switch (operation) {
    case 0:
      return x + y;
    case 1:
      return x - y;
    case 2:
      return x * y;
    case 3:
      return x / (2.0 + y * y);
    case 4:
      return sin(x);
    case 5:
      return cos(x) - y;
    case 6:
      return sqrt(1.0 + x * x);
    case 7:
      return exp(-x * x);
    case 8:
      return atan2(x, 1.0 + y * y);
    case 9:
      return x > y ? x : -y;
    case 10:
      return x * 0.5 + 3.0;
    case 11:
      return tanh(x);
    case 12:
      return T(0.25);  // all derivatives are forgotten
    default:
      return 1.0 / (1.5 + sin(y));
  }
}

template <typename T>
std::array<T, kNumValues> Compose(const std::array<T, kNumValues>& start, unsigned seed) {
  std::array<T, kNumValues> values = start;
  test::Random random(seed);
  for (int k = 0; k < 60; ++k) {
    const auto i = static_cast<std::size_t>(random.Below(kNumValues));
    const auto j = static_cast<std::size_t>(random.Below(kNumValues));
    values[i] = ApplyOperation(random.Below(14), values[i], values[j]);
    if (values[i] > 20.0 || values[i] < -20.0) {
      values[i] *= 0.01;
    }
  }
  return values;
}

template <int N>
void CompareCompositions() {
  for (unsigned seed = 1; seed <= 500; ++seed) {
    SCOPED_TRACE(seed);
    test::Random random(seed);
    std::array<Jet<N>, kNumValues> ours;
    std::array<ceres::Jet<double, N>, kNumValues> stock;
    for (std::size_t k = 0; k < kNumValues; ++k) {
      const double value = random.Between(-2.0, 2.0);
      const int i = random.Below(N);
      ours[k] = k == 0 ? Jet<N>(value) : Jet<N>(value, i);
      stock[k] = test::ToStock(ours[k]);
    }
    const auto our_result = Compose(ours, seed);
    const auto stock_result = Compose(stock, seed);
    for (std::size_t k = 0; k < kNumValues; ++k) {
      test::ExpectSame(our_result[k], stock_result[k], "composition");
    }
    if (::testing::Test::HasFailure()) {
      return;  // one is enough to look at
    }
  }
}

TEST(JetCompositions, OfOneDerivative) {
  CompareCompositions<1>();
}
TEST(JetCompositions, OfAnOddNumberOfDerivatives) {
  CompareCompositions<7>();
}
TEST(JetCompositions, OfAnEvenNumberOfDerivatives) {
  CompareCompositions<12>();
}
TEST(JetCompositions, OfTheLastUnrolledNumberOfDerivatives) {
  CompareCompositions<32>();
}
TEST(JetCompositions, OfTheFirstNumberOfDerivativesInLoops) {
  CompareCompositions<33>();
}
TEST(JetCompositions, OfManyDerivatives) {
  CompareCompositions<101>();
}

}  // namespace
}  // namespace inceres
