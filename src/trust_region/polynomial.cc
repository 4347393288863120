#include "trust_region/polynomial.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

namespace inceres::internal {
namespace {

// Small polynomials as Ceres 2.1's polynomial.cc has them, so that line searches and the subspace
// dog-leg take the same points up to rounding. Coefficients run from the highest power down. Real
// parts of complex roots count as candidates, too: whoever asks compares values at them.

// Scales row i by 2⁻ᵉ and column i by 2ᵉ until no such pair lowers their norms by a tenth any more.
// Source: Parlett & Reinsch, "Balancing a matrix for calculation of eigenvalues and eigenvectors",
// 1969. The sweeps end soon; the limit is for NaN.
void Balance(Eigen::MatrixXd* matrix) {
  constexpr double kWorthwhile = 0.9;
  constexpr int kMaxSweeps = 1000;
  // The diagonal is the same after balancing and takes no part in the norms.
  const Eigen::VectorXd diagonal = matrix->diagonal();
  matrix->diagonal().setZero();
  bool changed = true;
  for (int sweep = 0; changed && sweep < kMaxSweeps; ++sweep) {
    changed = false;
    for (Eigen::Index i = 0; i < matrix->rows(); ++i) {
      const double row = matrix->row(i).lpNorm<1>();
      const double column = matrix->col(i).lpNorm<1>();
      int exponent = 0;
      std::frexp(row / column, &exponent);
      // Half of it goes to the row, half to the column.
      exponent /= 2;
      if (exponent != 0 && std::ldexp(column, exponent) + std::ldexp(row, -exponent) <
                               kWorthwhile * (column + row)) {
        // Powers of two scale without rounding.
        matrix->row(i) *= std::ldexp(1.0, -exponent);
        matrix->col(i) *= std::ldexp(1.0, exponent);
        changed = true;
      }
    }
  }
  matrix->diagonal() = diagonal;
}

// Real parts of the roots of a x² + b x + c. The root that would cancel is found through the
// product of both (Horn).
std::vector<double> QuadraticRoots(double a, double b, double c) {
  const double discriminant = b * b - 4.0 * a * c;
  // A pair of complex roots has the same real part.
  if (discriminant < 0.0) {
    return {-b / (2.0 * a), -b / (2.0 * a)};
  }
  // −b and the root have the same sign here: their sum loses nothing.
  const double q = b >= 0.0 ? -b - std::sqrt(discriminant) : -b + std::sqrt(discriminant);
  const double direct = q / (2.0 * a);
  const double through_product = 2.0 * c / q;
  // The order of Ceres's roots, for the first of equal ones wins.
  return b >= 0.0 ? std::vector<double>{direct, through_product}
                  : std::vector<double>{through_product, direct};
}

bool CompanionRoots(const std::vector<double>& polynomial, std::vector<double>* roots) {
  // Companion matrix of the monic polynomial, coefficients in its last column.
  const auto degree = static_cast<Eigen::Index>(polynomial.size()) - 1;
  Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(degree, degree);
  companion.diagonal(-1).setOnes();
  for (Eigen::Index i = 0; i < degree; ++i) {
    companion(i, degree - 1) = -polynomial[static_cast<std::size_t>(degree - i)] / polynomial[0];
  }
  Balance(&companion);
  const Eigen::EigenSolver<Eigen::MatrixXd> solver(companion, /*computeEigenvectors=*/false);
  if (solver.info() != Eigen::Success) {
    return false;
  }
  const Eigen::VectorXd real = solver.eigenvalues().real();
  roots->assign(real.data(), real.data() + degree);
  return true;
}

// Of a constant nothing is left.
std::vector<double> Differentiate(const std::vector<double>& polynomial) {
  std::vector<double> derivative;
  for (std::size_t k = 0; k + 1 < polynomial.size(); ++k) {
    derivative.push_back(static_cast<double>(polynomial.size() - 1 - k) * polynomial[k]);
  }
  return derivative;
}

}  // namespace

// Horner's rule.
double EvaluatePolynomial(const std::vector<double>& polynomial, double x) {
  double value = 0.0;
  for (const double coefficient : polynomial) {
    value = value * x + coefficient;
  }
  return value;
}

// Closed forms where there are some, as Ceres has them.
bool RealPartsOfRoots(const std::vector<double>& polynomial, std::vector<double>* roots) {
  roots->clear();
  // Leading zeros are no degree; a polynomial of zeros is a constant.
  const auto leading =
      std::find_if(polynomial.begin(), polynomial.end(), [](double c) { return c != 0.0; });
  const std::vector<double> trimmed(leading, polynomial.end());
  if (trimmed.size() <= 1) {
    return true;
  }
  if (trimmed.size() == 2) {
    roots->push_back(-trimmed[1] / trimmed[0]);
    return true;
  }
  if (trimmed.size() == 3) {
    *roots = QuadraticRoots(trimmed[0], trimmed[1], trimmed[2]);
    return true;
  }
  return CompanionRoots(trimmed, roots);
}

// Rows of the Vandermonde system: powers for a value, their derivatives for a slope.
std::vector<double> Interpolate(const std::vector<FunctionSample>& samples) {
  Eigen::Index count = 0;
  for (const FunctionSample& sample : samples) {
    count += (sample.value_is_valid ? 1 : 0) + (sample.slope_is_valid ? 1 : 0);
  }
  Eigen::MatrixXd powers = Eigen::MatrixXd::Zero(count, count);
  Eigen::VectorXd wanted(count);
  // As many coefficients as conditions.
  const Eigen::Index degree = count - 1;
  Eigen::Index row = 0;
  for (const FunctionSample& sample : samples) {
    if (sample.value_is_valid) {
      for (Eigen::Index j = 0; j <= degree; ++j) {
        powers(row, j) = std::pow(sample.x, static_cast<double>(degree - j));
      }
      wanted(row++) = sample.value;
    }
    if (sample.slope_is_valid) {
      for (Eigen::Index j = 0; j < degree; ++j) {
        powers(row, j) = static_cast<double>(degree - j) *
                         std::pow(sample.x, static_cast<double>(degree - j - 1));
      }
      wanted(row++) = sample.slope;
    }
  }
  // Small x make small pivots that are meant.
  Eigen::FullPivLU<Eigen::MatrixXd> lu(powers);
  const Eigen::VectorXd polynomial = lu.setThreshold(0.0).solve(wanted);
  return std::vector<double>(polynomial.data(), polynomial.data() + count);
}

double MinimizeInterpolant(const std::vector<FunctionSample>& samples, double x_min, double x_max) {
  const std::vector<double> polynomial = Interpolate(samples);
  std::vector<double> candidates = {x_min, x_max};
  std::vector<double> roots;
  // Of a line the ends are compared; its derivative has no root.
  if (polynomial.size() > 2 && RealPartsOfRoots(Differentiate(polynomial), &roots)) {
    candidates.insert(candidates.end(), roots.begin(), roots.end());
  }
  for (const FunctionSample& sample : samples) {
    candidates.push_back(sample.x);
  }
  // Ceres begins with the middle, and takes another point only if that is lower. NaN never is.
  double best = 0.5 * (x_min + x_max);
  double lowest = EvaluatePolynomial(polynomial, best);
  for (const double x : candidates) {
    const double value = EvaluatePolynomial(polynomial, x);
    if (!(x < x_min) && !(x > x_max) && value < lowest) {
      best = x;
      lowest = value;
    }
  }
  return best;
}

}  // namespace inceres::internal
