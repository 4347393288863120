#include <cmath>
#include <cstddef>

#include <Eigen/Geometry>

#include "factors/pose_slot.h"
#include "factors/relative_error.h"
#include "factors/whiten.h"
#include "inceres/factors/relative_pose.h"
#include "inceres/problem/rotation.h"

// A measured relative pose in four conventions, from the same ingredients: E = R_mᵀ R_aᵀ R_b with r
// = Log E and ε the vector of its quaternion, and u = R_aᵀ (p_b − p_a) − p_m. What each program
// writes is a linear function of u, r or ε, but for GTSAM's position, whose factor J_l⁻¹(r) turns
// with r. So derivatives are formed of u, r and ε once (DifferentiateEdge), and each convention
// multiplies them as it does the values. All are exact, not the approximation J_r⁻¹ ≈ I that holds
// near r = 0: away from it, that would give steps of a wrong length.

namespace inceres {
namespace {

using internal::Matrix3;
using internal::RelativeError;
using internal::Skew;
using Matrix6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
using Eigen::Vector3d;

// The formulas are those of the header, in the same order.
void WriteError(PoseErrorConvention convention, const RelativeError& e, double* error) {
  Eigen::Map<Vector3d> position(error), rotation(error + 3);
  switch (convention) {
    case PoseErrorConvention::kGeodesic:
      position = e.u;
      rotation = e.r;
      return;
    case PoseErrorConvention::kCeres:
      position = e.u;
      rotation = -2.0 * (e.R_m * e.epsilon());
      return;
    case PoseErrorConvention::kG2o:
      position = e.R_m.transpose() * e.u;
      rotation = e.epsilon();
      return;
    case PoseErrorConvention::kGtsam:
      position = e.J_l_inverse * (e.R_m.transpose() * e.u);
      rotation = e.r;
      return;
  }
}

// k'(t) of k(t) = InverseLeftJacobianCoefficient at t = θ². Near zero by the series of h cot h
// (Abramowitz & Stegun 4.3.70), the first term left out below 1e-11 of the sum.
double SlopeOfCoefficient(double t) {
  if (t < 0.3) {
    return 1.0 / 720.0 +
           t * (1.0 / 15120.0 +
                t * (1.0 / 403200.0 + t * (1.0 / 11975040.0 + t * (691.0 / 261534873600.0 +
                                                                   t * 1.0 / 12454041600.0))));
  }
  // The closed form with h = θ/2: h cot h has the derivative cot h − h / sin² h, and dh/dt = 1 /
  // (8h).
  const double h = 0.5 * std::sqrt(t);
  const double cot = std::cos(h) / std::sin(h), sine = std::sin(h);
  return -(cot - h / (sine * sine)) / (8.0 * h * t) - (1.0 - h * cot) / (t * t);
}

// ∂(J_l⁻¹(r) c)/∂r with J_l⁻¹(r) c = c − ½ r × c + k r × (r × c).
Matrix3 DifferentiateInverseJacobian(const Vector3d& r, const Vector3d& c) {
  // Of the three terms: −½ r × c gives ½ [c]×; r × (r × c) = r (r·c) − c (r·r) gives k (r cᵀ +
  // (r·c) I − 2 c rᵀ); and k depends on t = r·r, whose derivative is 2 r.
  const double t = r.squaredNorm();
  const double k = InverseLeftJacobianCoefficient(r.data());
  const Vector3d twice = r.cross(r.cross(c));
  return 0.5 * Skew(c) +
         k * (r * c.transpose() + r.dot(c) * Matrix3::Identity() - 2.0 * c * r.transpose()) +
         2.0 * SlopeOfCoefficient(t) * twice * r.transpose();
}

// Of u and, as the vector that `rotate` makes of it, of E's rotation error to right perturbations
// R Exp(φ), with E ↦ Exp(−R_mᵀ φ_a) E and E Exp(φ_b).
struct EdgeSlopes {
  Matrix3 u_p;  // to p
  Matrix3 u_r;  // to φ
  Matrix3 r;    // of r to φ
  Matrix3 q;    // of ε to φ
};

// Slot 0 is a, slot 1 is b. u does not depend on the rotation of b.
EdgeSlopes DifferentiateEdge(const RelativeError& e, int slot) {
  EdgeSlopes slopes;
  // 2 vec(Exp(x) ⊗ q) ≈ 2 ε + (w I − [ε]×) x from the left, with a plus from the right.
  const Matrix3 turn = Skew(e.epsilon());
  if (slot == 0) {
    slopes.u_p = -e.R_a.transpose();
    // R_a Exp(φ) turns t by −φ, which adds t × φ.
    slopes.u_r = Skew(e.t);
    slopes.r = -e.J_l_inverse * e.R_m.transpose();
    slopes.q = -0.5 * (e.q[3] * Matrix3::Identity() - turn) * e.R_m.transpose();
  } else {
    slopes.u_p = e.R_a.transpose();
    slopes.u_r = Matrix3::Zero();
    slopes.r = e.J_l_inverse.transpose();  // J_r⁻¹(r) = J_l⁻¹(r)ᵀ
    slopes.q = 0.5 * (e.q[3] * Matrix3::Identity() + turn);
  }
  return slopes;
}

// Columns δp, φ; the lower left block is zero, for no convention's rotation depends on positions.
Matrix6 EdgeJacobian(PoseErrorConvention convention, const RelativeError& e, int slot) {
  const EdgeSlopes slopes = DifferentiateEdge(e, slot);
  Matrix6 J = Matrix6::Zero();
  // Into the axes of the measured pose, where g2o and GTSAM have the position's error.
  const Matrix3 back = e.R_m.transpose();
  switch (convention) {
    case PoseErrorConvention::kGeodesic:
      J << slopes.u_p, slopes.u_r, Matrix3::Zero(), slopes.r;
      break;
    case PoseErrorConvention::kCeres:
      J << slopes.u_p, slopes.u_r, Matrix3::Zero(), -2.0 * e.R_m * slopes.q;
      break;
    case PoseErrorConvention::kG2o:
      J << back * slopes.u_p, back * slopes.u_r, Matrix3::Zero(), slopes.q;
      break;
    case PoseErrorConvention::kGtsam:
      // The product rule: J_l⁻¹(r) of the moved vector, and of the moved r.
      J << e.J_l_inverse * back * slopes.u_p,
          e.J_l_inverse * back * slopes.u_r +
              DifferentiateInverseJacobian(e.r, back * e.u) * slopes.r,
          Matrix3::Zero(), slopes.r;
      break;
  }
  return J;
}

}  // namespace

const char* ToString(PoseErrorConvention convention) {
  switch (convention) {
    case PoseErrorConvention::kGeodesic:
      return "geodesic";
    case PoseErrorConvention::kCeres:
      return "ceres";
    case PoseErrorConvention::kG2o:
      return "g2o";
    case PoseErrorConvention::kGtsam:
      return "gtsam";
  }
  return "unknown";
}

EvaluationFailure PoseEdgeFamily::Evaluate(const FactorBatch& batch) const {
  return internal::EvaluateEach(batch, [&](int i) {
    const Measurement& m = measurement(i);
    const double* const* parameters = batch.parameters + 2 * static_cast<std::ptrdiff_t>(i);
    const RelativeError e = internal::MeasureRelative(m.p_m, m.q_m, parameters[0], parameters[1]);
    double error[6];
    WriteError(convention_, e, error);
    const auto differentiate = [&](int slot, double E[6][6]) {
      Eigen::Map<Matrix6> map(&E[0][0]);
      map = EdgeJacobian(convention_, e, slot);
    };
    return internal::WritePoseFactor(batch, i, 2, m.sqrt_information, error, false, differentiate);
  });
}

}  // namespace inceres
