#include "inceres/factors/diagonal_prior.h"

#include <limits>

#include <gtest/gtest.h>

#include "factors/numeric_jacobian.h"
#include "inceres/problem/manifolds.h"

namespace inceres {
namespace {

using test::EvaluateFactor;
using test::FactorState;
using test::FactorValues;

TEST(DiagonalPrior, JacobiansAtAThousandStates) {
  test::Random random(41);
  const SubsetManifold pose_only(9, {6, 7, 8});
  const SubsetManifold middle(9, {0, 4, 8});
  struct Case {
    int size, ambient_size, tangent_size;
    const Manifold* manifold;
  };
  const Case cases[] = {{1, 1, 1, nullptr},
                        {3, 3, 3, nullptr},
                        {6, 9, 9, nullptr},
                        {6, 9, 6, &pose_only},
                        {6, 9, 6, &middle}};
  for (int i = 0; i < 1000; ++i) {
    const Case& c = cases[i % 5];
    DiagonalPriorFamily family(c.size, c.ambient_size, c.tangent_size);
    const auto size = static_cast<std::size_t>(c.size);
    family.Add({random.Vector(size), random.Vector(size)});
    test::ExpectNumericJacobians(
        family, {{random.Vector(static_cast<std::size_t>(c.ambient_size))}, {c.manifold}}, 1e-10,
        i);
  }
}

TEST(DiagonalPrior, ASelectionGivesWhatTheProductGives) {
  const SubsetManifold middle(9, {0, 4, 8});
  const int selection[6] = {1, 2, 3, 5, 6, 7};
  test::Random random(42);
  DiagonalPriorFamily family(7, 9, 6);
  family.Add({random.Vector(7), random.Vector(7)});
  const FactorState state{{random.Vector(9)}, {&middle}};
  const FactorValues dense = EvaluateFactor(family, state);

  const TangentMap map{TangentMap::Kind::kSelection, 9, 6, nullptr, selection};
  const TangentMap* maps[] = {&map};
  const double* parameters[] = {state.parameters[0].data()};
  std::vector<double> residuals(7), J(42, test::kUnwritten);
  const JacobianView view{J.data(), 0, 6};
  ASSERT_FALSE(family.Evaluate({0, 1, parameters, maps, residuals.data(), &view}).failed());
  EXPECT_EQ(J, dense.jacobians[0]);
  EXPECT_EQ(residuals, dense.residuals);
}

TEST(DiagonalPrior, ResidualsOfSeveralFactors) {
  DiagonalPriorFamily family(2);
  family.Add({{1.0, 2.0}, {10.0, 100.0}});
  family.Add({{3.0, 4.0}, {0.5, 0.0}});
  EXPECT_EQ(family.size(), 2);
  const double x[2] = {2.0, 2.5};
  const double* parameters[] = {x, x};
  double residuals[4];
  ASSERT_FALSE(family.Evaluate({0, 2, parameters, nullptr, residuals, nullptr}).failed());
  EXPECT_EQ(residuals[0], 10.0);
  EXPECT_EQ(residuals[1], 50.0);
  EXPECT_EQ(residuals[2], -0.5);
  EXPECT_EQ(residuals[3], 0.0);

  const double bad[2] = {2.0, std::numeric_limits<double>::quiet_NaN()};
  parameters[1] = bad;
  EXPECT_EQ(family.Evaluate({0, 2, parameters, nullptr, residuals, nullptr}).factor, 1);
}

}  // namespace
}  // namespace inceres
