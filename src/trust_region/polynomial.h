#pragma once

#include <vector>

namespace inceres::internal {

/// Polynomials of the few coefficients that a line search or a trust region in a plane needs; the
/// highest power comes first. Source: Ceres 2.1's choices (which roots count, which points are
/// compared), so that steps agree with its to rounding.

double EvaluatePolynomial(const std::vector<double>& polynomial, double x);

/// The real parts of all roots, complex ones included: roots of degree 1 and 2 in closed form,
/// above that the eigenvalues of the balanced companion matrix. None for a constant. False if the
/// eigenvalues cannot be computed; `roots` is then empty.
bool RealPartsOfRoots(const std::vector<double>& polynomial, std::vector<double>* roots);

/// What is known of a function at x.
struct FunctionSample {
  double x = 0.0;
  double value = 0.0;
  double slope = 0.0;
  bool value_is_valid = false;
  bool slope_is_valid = false;
};

/// The polynomial of least degree through everything valid of the samples. They must hold at least
/// one valid entry.
std::vector<double> Interpolate(const std::vector<FunctionSample>& samples);

/// Where in [x_min, x_max] the interpolating polynomial is lowest, among: the middle, the ends, the
/// real parts of the roots of its derivative, and the samples.
double MinimizeInterpolant(const std::vector<FunctionSample>& samples, double x_min, double x_max);

}  // namespace inceres::internal
