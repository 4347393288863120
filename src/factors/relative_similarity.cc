#include <cassert>
#include <cmath>
#include <cstddef>
#include <optional>

#include <Eigen/Geometry>

#include "factors/relative_error.h"
#include "factors/similarity_log.h"
#include "factors/whiten.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/rotation.h"

namespace inceres {

// A measured relative similarity S_m of two poses with a scale (Strasdat, Montiel & Davison 2010),
// for loop closures where the unit of length drifts. With S = (p, R, s), a point X goes to
// s R X + p, and
//
//     S_E = S_m⁻¹ S_a⁻¹ S_b:  R_E = R_mᵀ R_aᵀ R_b,  s_E = s_b / (s_a s_m),  t_E = R_mᵀ u / s_m,
//     with u = R_aᵀ (p_b − p_a) / s_a − p_m.
//
// Both conventions have r = Log R_E and λ = ln s_E; they differ in the position's part, u or
// V(r, λ)⁻¹ t_E, where V is the matrix by which the exponential of Sim(3) moves
// (factors/similarity_log.h). So the first is evaluated in either case, and the second is a map on
// top of it, by the chain rule.
//
// Perturbations are SimilarityManifold's: p + δ, R Exp(φ), s e^σ. The whitening by U is a product
// with an upper triangle, which also yields the sum by which results that are not finite are found.

namespace {

using internal::Matrix3;
using internal::SimilarityLog;
using Matrix7 = Eigen::Matrix<double, 7, 7, Eigen::RowMajor>;
using Vector7 = Eigen::Matrix<double, 7, 1>;
using Eigen::Vector3d;

// What the errors of both conventions are made of.
struct SimilarityError : internal::RelativeError {
  double s_a;
  double lambda;  // ln s_E
};

SimilarityError MeasureSimilarity(const RelativeSimilarityFamily::Measurement& m, const double* a,
                                  const double* b) {
  // By a difference of logarithms: the quotient could overflow where its logarithm is ordinary.
  return {internal::MeasureRelative(m.p_m, m.q_m, a, b, a[7]), a[7],
          std::log(b[7]) - std::log(a[7]) - std::log(m.s_m)};
}

// The derivatives of u, r and λ by the tangent of a slot, as their residuals stand.
//
// With right perturbations R_E becomes Exp(−R_mᵀ φ_a) R_E and R_E Exp(φ_b), so
//     ∂r/∂φ_a = −J_l⁻¹(r) R_mᵀ,      ∂r/∂φ_b = J_r⁻¹(r) = J_l⁻¹(r)ᵀ,
//     ∂t/∂p_a = −R_aᵀ/s_a = −∂t/∂p_b,  ∂t/∂φ_a = [t]×,  ∂t/∂σ_a = −t,
// where s_a e^{σ_a} is the scale moved; λ follows σ_b and −σ_a.
Matrix7 DifferentiateSimilarity(const SimilarityError& e, int slot) {
  Matrix7 J = Matrix7::Zero();
  const double sign = slot == 0 ? -1.0 : 1.0;
  // Columns are δ, φ, σ; rows u, r, λ.
  J.topLeftCorner<3, 3>() = sign / e.s_a * e.R_a.transpose();
  J(6, 6) = sign;
  if (slot == 0) {
    J.block<3, 3>(0, 3) = internal::Skew(e.t);
    J.topRightCorner<3, 1>() = -e.t;
    // φ_a reaches r from the left, so by the left Jacobian; φ_b from the right.
    J.block<3, 3>(3, 3) = -e.J_l_inverse * e.R_m.transpose();
  } else {
    J.block<3, 3>(3, 3) = e.J_l_inverse.transpose();
  }
  return J;
}

// y = V⁻¹ R_mᵀ u / s_m, and its derivative from those of u, r and λ:
//     δy = V⁻¹ (R_mᵀ δu / s_m − ∂(V y)/∂r δr − ∂(V y)/∂λ δλ).
// From V(r, λ) y = t_E: both sides are differentiated, and solved for δy.
class LogOfError {
 public:
  LogOfError(const SimilarityError& e, double s_m)
      : log_(e.r, e.lambda), turn_(e.R_m.transpose() / s_m), y_(log_.inverse() * (turn_ * e.u)) {}

  const Vector3d& y() const { return y_; }
  // Rows of r and λ stay; those of u become those of y.
  void Differentiate(Matrix7* J) const {
    const Eigen::Matrix<double, 3, 7> top = turn_ * J->topRows<3>() -
                                            log_.DerivativeByRotation(y_) * J->middleRows<3>(3) -
                                            log_.DerivativeByScale(y_) * J->row(6);
    J->topRows<3>() = log_.inverse() * top;
  }

 private:
  SimilarityLog log_;
  Matrix3 turn_;
  Vector3d y_;
};

// The map a slot's formulas are written for; one that merely selects columns is a wrapper's doing.
// Entries of ∂(x ⊞ δ)/∂δ that tell SimilarityManifold from others. J is written in the tangent
// space at once, without a product with that matrix.
void AssertSimilarityManifold(const TangentMap& map, const double* x) {
  assert(map.kind != TangentMap::Kind::kDense ||
         (map.plus_jacobian[0] == 1.0 && map.plus_jacobian[3 * 7 + 3] == 0.5 * x[6] &&
          map.plus_jacobian[4 * 7 + 3] == 0.5 * x[5] && map.plus_jacobian[7 * 7 + 6] == x[7]));
  static_cast<void>(map);
  static_cast<void>(x);
}

// Null, or what is wrong.
const char* EvaluateSimilarity(const FactorBatch& batch, int i,
                               SimilarityErrorConvention convention,
                               const RelativeSimilarityFamily::Measurement& m) {
  const double* const* parameters = batch.parameters + 2 * static_cast<std::ptrdiff_t>(i);
  // The log of a scale that is not positive does not exist: looked at first. NaN fails the
  // comparison.
  if (!(parameters[0][7] > 0.0 && parameters[1][7] > 0.0 && m.s_m > 0.0)) {
    return "a scale is not positive";
  }
  const SimilarityError e = MeasureSimilarity(m, parameters[0], parameters[1]);
  Vector7 error;
  error << e.u, e.r, e.lambda;
  // V is formed for the convention that needs it only.
  std::optional<LogOfError> log;
  if (convention == SimilarityErrorConvention::kLogarithm) {
    log.emplace(e, m.s_m);
    error.head<3>() = log->y();
  }
  const double* const U = m.sqrt_information;
  const auto write_slot = [&](int slot, const TangentMap& map, const double* x) {
    AssertSimilarityManifold(map, x);
    Matrix7 J = DifferentiateSimilarity(e, slot);
    if (log.has_value()) {
      log->Differentiate(&J);
    }
    return internal::WriteSlot<7, 7>(batch, i, slot, U, J.data());
  };
  return internal::WriteFactor<7>(batch, i, 2, U, error.data(), write_slot);
}

}  // namespace

// Products of many quaternions drift from unit length, so the result is scaled back.
void ComposeSimilarities(const double a[8], const double b[8], double c[8]) {
  double R[9], turned[3];
  QuaternionToMatrix(a + 3, R);
  MultiplyMatrixVector(R, b, turned);
  for (int k = 0; k < 3; ++k) {
    c[k] = a[k] + a[7] * turned[k];
  }
  MultiplyQuaternions(a + 3, b + 3, c + 3);
  const double norm = std::sqrt(c[3] * c[3] + c[4] * c[4] + c[5] * c[5] + c[6] * c[6]);
  for (int k = 3; k < 7; ++k) {
    c[k] /= norm;
  }
  c[7] = a[7] * b[7];
}

// p' = −Rᵀ p / s. The quaternion is conjugated, not normalized.
void InvertSimilarity(const double a[8], double inverse[8]) {
  double R[9];
  ConjugateQuaternion(a + 3, inverse + 3);
  QuaternionToMatrix(inverse + 3, R);
  const double back[3] = {-a[0] / a[7], -a[1] / a[7], -a[2] / a[7]};
  MultiplyMatrixVector(R, back, inverse);
  inverse[7] = 1.0 / a[7];
}

const char* ToString(SimilarityErrorConvention convention) {
  switch (convention) {
    case SimilarityErrorConvention::kGeodesic:
      return "geodesic";
    case SimilarityErrorConvention::kLogarithm:
      return "logarithm";
  }
  return "unknown";
}

EvaluationFailure RelativeSimilarityFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluateEach(
      batch, [&](int i) { return EvaluateSimilarity(batch, i, convention_, measurement(i)); });
}

}  // namespace inceres
