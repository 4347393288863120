#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

#include "inceres/problem/factor_family.h"
#include "inceres/problem/manifolds.h"
#include "support/random_values.h"

namespace inceres::test {

/// One factor of a family at one state. A null manifold means Euclidean.
struct FactorState {
  std::vector<std::vector<double>> parameters;
  std::vector<const Manifold*> manifolds;
};

/// Residuals and tangent Jacobians (row-major, residual_size × tangent_size) of factor 0, all
/// variables free; `held` is constant.
struct FactorValues {
  std::vector<double> residuals;
  std::vector<std::vector<double>> jacobians;
  EvaluationFailure failure;
};

inline constexpr double kUnwritten = -7.25e77;

inline FactorValues EvaluateFactor(const FactorFamily& family, const FactorState& state,
                                   int held = -1) {
  FactorValues values;
  const auto num_slots = static_cast<std::size_t>(family.num_slots());
  values.residuals.assign(static_cast<std::size_t>(family.residual_size()), kUnwritten);
  std::vector<const double*> parameters;
  std::vector<std::vector<double>> plus_jacobians(num_slots);
  std::vector<TangentMap> maps(num_slots);
  std::vector<const TangentMap*> map_pointers;
  std::vector<JacobianView> views;
  for (std::size_t s = 0; s < num_slots; ++s) {
    const FactorFamily::Slot& slot = family.slot(static_cast<int>(s));
    parameters.push_back(state.parameters[s].data());
    maps[s].ambient_size = slot.ambient_size;
    maps[s].tangent_size = slot.tangent_size;
    if (static_cast<int>(s) == held) {
      maps[s].kind = TangentMap::Kind::kConstant;
    } else if (state.manifolds[s] != nullptr) {
      plus_jacobians[s].resize(static_cast<std::size_t>(slot.ambient_size * slot.tangent_size));
      EXPECT_TRUE(state.manifolds[s]->PlusJacobian(parameters[s], plus_jacobians[s].data()));
      maps[s].kind = TangentMap::Kind::kDense;
      maps[s].plus_jacobian = plus_jacobians[s].data();
    }
    map_pointers.push_back(&maps[s]);
    values.jacobians.emplace_back(
        static_cast<std::size_t>(family.residual_size() * slot.tangent_size), kUnwritten);
  }
  for (std::size_t s = 0; s < num_slots; ++s) {
    views.push_back({values.jacobians[s].data(), 0, family.slot(static_cast<int>(s)).tangent_size});
  }
  values.failure = family.Evaluate(
      {0, 1, parameters.data(), map_pointers.data(), values.residuals.data(), views.data()});
  return values;
}

/// Residuals of factor 0, cost-only call, with variable s moved by δ.
inline std::vector<double> ResidualsAt(const FactorFamily& family, const FactorState& state,
                                       std::size_t s, const std::vector<double>& delta) {
  std::vector<double> moved = state.parameters[s];
  if (state.manifolds[s] != nullptr) {
    EXPECT_TRUE(state.manifolds[s]->Plus(state.parameters[s].data(), delta.data(), moved.data()));
  } else {
    for (std::size_t k = 0; k < moved.size(); ++k) {
      moved[k] += delta[k];
    }
  }
  std::vector<const double*> parameters;
  for (const std::vector<double>& values : state.parameters) {
    parameters.push_back(values.data());
  }
  parameters[s] = moved.data();
  std::vector<double> residuals(static_cast<std::size_t>(family.residual_size()), kUnwritten);
  EXPECT_FALSE(
      family.Evaluate({0, 1, parameters.data(), nullptr, residuals.data(), nullptr}).failed());
  return residuals;
}

/// Compares all Jacobians of factor 0 with central differences of fourth order along the manifolds;
/// the tolerance is relative to the largest entry of the block. Also: a constant variable's block
/// is not written, and its being constant changes nothing else.
inline void ExpectNumericJacobians(const FactorFamily& family, const FactorState& state,
                                   double tolerance, int index) {
  constexpr double kStep = 1e-3;
  const FactorValues values = EvaluateFactor(family, state);
  ASSERT_FALSE(values.failure.failed()) << values.failure.reason << ", state " << index;
  for (std::size_t s = 0; s < state.parameters.size(); ++s) {
    const auto columns = static_cast<std::size_t>(family.slot(static_cast<int>(s)).tangent_size);
    double largest = 1e-3;
    for (const double entry : values.jacobians[s]) {
      largest = std::fmax(largest, std::fabs(entry));
    }
    for (std::size_t c = 0; c < columns; ++c) {
      std::vector<double> at[4];
      const double steps[4] = {-2.0 * kStep, -kStep, kStep, 2.0 * kStep};
      for (std::size_t k = 0; k < 4; ++k) {
        std::vector<double> delta(columns, 0.0);
        delta[c] = steps[k];
        at[k] = ResidualsAt(family, state, s, delta);
      }
      for (std::size_t r = 0; r < values.residuals.size(); ++r) {
        const double numeric =
            (at[0][r] - 8.0 * at[1][r] + 8.0 * at[2][r] - at[3][r]) / (12.0 * kStep);
        ASSERT_NEAR(values.jacobians[s][r * columns + c], numeric, tolerance * largest)
            << "state " << index << ", slot " << s << ", row " << r << ", column " << c;
      }
    }
    const FactorValues held = EvaluateFactor(family, state, static_cast<int>(s));
    ASSERT_EQ(held.residuals, values.residuals);
    for (std::size_t other = 0; other < state.parameters.size(); ++other) {
      const std::vector<double> untouched(held.jacobians[other].size(), kUnwritten);
      ASSERT_EQ(held.jacobians[other], other == s ? untouched : values.jacobians[other])
          << "state " << index << ", slot " << s;
    }
  }
}

/// A rotation of that angle about a random axis, x, y, z, w.
inline void RandomRotation(Random& random, double angle, double q[4]) {
  double axis[3];
  double norm = 0.0;
  do {
    norm = 0.0;
    for (double& a : axis) {
      a = random.Unit();
      norm = std::hypot(norm, a);
    }
  } while (norm < 0.1);
  const double sine = std::sin(0.5 * angle);
  for (int k = 0; k < 3; ++k) {
    q[k] = sine * axis[k] / norm;
  }
  q[3] = std::cos(0.5 * angle);
}

}  // namespace inceres::test
