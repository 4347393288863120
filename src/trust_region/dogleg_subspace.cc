#include "trust_region/dogleg_subspace.h"

#include <cmath>
#include <limits>

#include <Eigen/LU>
#include <Eigen/QR>

#include "trust_region/polynomial.h"

namespace inceres::internal {
namespace {

// The minimum of the model on the sphere, in a plane (docs/algorithms.md, "Dog-leg"; Byrd,
// Schnabel & Shultz 1988). The multiplier y is a root of a quartic; real parts of all four roots
// are tried, for rounding may give a double root an imaginary part. Which is best is decided by
// the model, and whether it is a minimum at all by the angle between −x and the model's gradient.

using Eigen::Matrix2d;
using Eigen::Vector2d;

// A minimum on the sphere has its gradient along −x; less than this cosine, and the root was not
// one.
constexpr double kMinCosine = 0.99;

Eigen::Map<const Eigen::VectorXd> AsVector(const std::vector<double>& v) {
  return {v.data(), static_cast<Eigen::Index>(v.size())};
}

// VᵀHV. The mixed entry comes from columns of equal length in H, so that it is as exact as a dot
// product of the columns of JV.
// A polarization identity for V₀ᵀHV₁: with both columns of unit length in H the sum's square is 2
// + 2 cosine.
Matrix2d Restrict(LinearModel* model, const Eigen::MatrixX2d& V) {
  const Vector2d lengths(std::sqrt(model->Quadratic(V.col(0).data())),
                         std::sqrt(model->Quadratic(V.col(1).data())));
  double cosine = 0.0;
  // A direction without curvature has no mixed entry either.
  if (lengths.minCoeff() > 0.0) {
    const Eigen::VectorXd sum = V.col(0) / lengths[0] + V.col(1) / lengths[1];
    cosine = 0.5 * model->Quadratic(sum.data()) - 1.0;
  }
  Matrix2d B;
  B << lengths[0] * lengths[0], cosine * lengths[0] * lengths[1], cosine * lengths[0] * lengths[1],
      lengths[1] * lengths[1];
  return B;
}

// The quartic of the class comment, highest power first.
std::vector<double> MultiplierPolynomial(const Matrix2d& B, const Vector2d& g, double radius) {
  // R is the squared radius here.
  const double R = radius * radius;
  const double trace = B.trace();
  const double determinant = B.determinant();
  Matrix2d adjugate;
  adjugate << B(1, 1), -B(0, 1), -B(1, 0), B(0, 0);
  return {R, 2.0 * R * trace, R * (trace * trace + 2.0 * determinant) - g.squaredNorm(),
          -2.0 * (g.dot(adjugate * g) - R * determinant * trace),
          R * determinant * determinant - (adjugate * g).squaredNorm()};
}

}  // namespace

// Once a point: the basis and the model in it serve all radii.
bool DoglegSubspace::Build(const std::vector<double>& w, const std::vector<double>& gradient,
                           const std::vector<double>& gauss_newton, LinearModel* model) {
  const auto n = static_cast<Eigen::Index>(w.size());
  Eigen::MatrixX2d vectors(n, 2);
  vectors << AsVector(gradient), AsVector(gauss_newton);
  // Rank by pivoting, as Ceres decides it.
  const Eigen::ColPivHouseholderQR<Eigen::MatrixX2d> qr(vectors);
  // Gradient and Gauss–Newton step are parallel: the plane is a line.
  one_dimensional_ = qr.rank() == 1;
  if (qr.rank() != 2) {
    return one_dimensional_;
  }
  basis_ = qr.householderQ() * Eigen::MatrixX2d::Identity(n, 2);
  g_ = basis_.transpose() * AsVector(gradient);
  // In the metric: columns of W⁻¹U.
  B_ = Restrict(model, AsVector(w).cwiseInverse().asDiagonal() * basis_);
  return true;
}

bool DoglegSubspace::MinimizeOnBoundary(double radius, const std::vector<double>& gradient,
                                        double* p) const {
  Eigen::Map<Eigen::VectorXd> result(p, static_cast<Eigen::Index>(gradient.size()));
  if (one_dimensional_) {
    result = -(radius / AsVector(gradient).norm()) * AsVector(gradient);
    return true;
  }
  const Vector2d x = FindMinimum(radius);
  const Vector2d slope = B_ * x + g_;
  // Negated, so that NaN fails; a zero x means that there was no root.
  if (!(-x.dot(slope) >= kMinCosine * x.norm() * slope.norm()) || x.isZero(0.0)) {
    return false;
  }
  result = basis_ * x;
  return true;
}

// Candidates are compared where they meet the sphere, for a root that is off a little is off it
// too, but taken as they are. Zero if there is none.
Vector2d DoglegSubspace::FindMinimum(double radius) const {
  Vector2d best = Vector2d::Zero();
  double lowest = std::numeric_limits<double>::max();
  std::vector<double> roots;
  RealPartsOfRoots(MultiplierPolynomial(B_, g_, radius), &roots);
  for (const double y : roots) {
    const Matrix2d shifted = B_ + y * Matrix2d::Identity();
    const Vector2d x = -shifted.partialPivLu().solve(g_);
    // A root of zero length gives no direction.
    if (x.norm() > 0.0) {
      const Vector2d on_sphere = (radius / x.norm()) * x;
      const double value = 0.5 * on_sphere.dot(B_ * on_sphere) + g_.dot(on_sphere);
      if (value < lowest) {
        lowest = value;
        best = x;
      }
    }
  }
  return best;
}

}  // namespace inceres::internal
