#include "inceres/factors/body_reprojection.h"

#include <cmath>

#include "factors/pose_slot.h"
#include "inceres/graph/rotation.h"

namespace inceres {
namespace {

using internal::MultiplyTransposed;

enum Slot { kPoseI, kPoseJ, kCamera, kFeature, kTimeOffset };

// The values of one projection, stage by stage, that both the residual and the Jacobians need.
struct Projection {
  double lambda;
  double R_i[9], R_j[9], R_c[9];
  double baseline[3];  // p_i − p_j
  double m[3];
  double b_i[3];  // R_c m + λ t_c: λ times the point on the body at i
  double b_j[3];  // R_jᵀ (R_i b_i + λ (p_i − p_j)): on the body at j
  double h[3];    // R_cᵀ (b_j − λ t_c): in the camera at j
  double u[2];    // h_xy / h_z
};

void Project(const double* const* x, bool has_bearing, double tau, const BodyReprojectionFamily::Measurement& measurement,
             Projection* v) {
  const double* bearing = has_bearing ? x[kFeature] : measurement.point_i;
  const double lambda = x[kFeature][has_bearing ? 2 : 0];
  v->lambda = lambda;
  const double* t_c = x[kCamera];
  QuaternionToMatrix(x[kPoseI] + 3, v->R_i);
  QuaternionToMatrix(x[kPoseJ] + 3, v->R_j);
  QuaternionToMatrix(x[kCamera] + 3, v->R_c);
  for (int k = 0; k < 2; ++k) {
    v->m[k] = bearing[k] - (tau - measurement.offset_i) * measurement.velocity_i[k];
  }
  v->m[2] = 1.0;
  double world[3], on_body[3];
  MultiplyMatrixVector(v->R_c, v->m, v->b_i);
  for (int k = 0; k < 3; ++k) {
    v->b_i[k] += lambda * t_c[k];
    v->baseline[k] = x[kPoseI][k] - x[kPoseJ][k];
  }
  MultiplyMatrixVector(v->R_i, v->b_i, world);
  for (int k = 0; k < 3; ++k) {
    world[k] += lambda * v->baseline[k];
  }
  MultiplyTransposed(v->R_j, world, v->b_j);
  for (int k = 0; k < 3; ++k) {
    on_body[k] = v->b_j[k] - lambda * t_c[k];
  }
  MultiplyTransposed(v->R_c, on_body, v->h);
  v->u[0] = v->h[0] / v->h[2];
  v->u[1] = v->h[1] / v->h[2];
}

double Dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// One row of each Jacobian from a = ∂residual_r/∂h, which goes back stage by stage: a_b = R_c a for b_j, a_w = R_j a_b for the
// world, a_i = R_iᵀ a_w for b_i, a_m = R_cᵀ a_i for m. With right perturbations R Exp(φ), where ∂(R v)/∂φ = −R[v]× and ∂(Rᵀv)/∂φ
// = [Rᵀv]×:
//     p_i: λ a_w = −p_j,   φ_i: b_i × a_i,   φ_j: a_b × b_j,   t_c: λ (a_i − a_b),   φ_c: m × a_m + a × h,
//     m: a_m,   λ: a_i·t_c + a_w·(p_i − p_j) − a_b·t_c,   τ: −a_m·ṁ_i, and what the observation itself moves by, U ż_j.
class Rows {
 public:
  Rows(const Projection& v, const double* const* x, const double a[3]) : v_(v), x_(x), a_(a) {
    MultiplyMatrixVector(v.R_c, a, a_b_);
    MultiplyMatrixVector(v.R_j, a_b_, a_w_);
    MultiplyTransposed(v.R_i, a_w_, a_i_);
    MultiplyTransposed(v.R_c, a_i_, a_m_);
  }

  void PoseI(double* row) const {
    Cross(v_.b_i, a_i_, row + 3);
    for (int k = 0; k < 3; ++k) {
      row[k] = lambda() * a_w_[k];
    }
  }
  void PoseJ(double* row) const {
    Cross(a_b_, v_.b_j, row + 3);
    for (int k = 0; k < 3; ++k) {
      row[k] = -lambda() * a_w_[k];
    }
  }
  void Camera(double* row) const {
    double at_i[3], at_j[3];
    Cross(v_.m, a_m_, at_i);
    Cross(a_, v_.h, at_j);
    for (int k = 0; k < 3; ++k) {
      row[k] = lambda() * (a_i_[k] - a_b_[k]);
      row[3 + k] = at_i[k] + at_j[k];
    }
  }
  void Feature(bool has_bearing, double* row) const {
    if (has_bearing) {
      row[0] = a_m_[0];
      row[1] = a_m_[1];
    }
    row[has_bearing ? 2 : 0] = Dot(a_i_, x_[kCamera]) + Dot(a_w_, v_.baseline) - Dot(a_b_, x_[kCamera]);
  }
  void TimeOffset(const double velocity_i[2], double weighted_velocity_j, double* row) const {
    row[0] = weighted_velocity_j - a_m_[0] * velocity_i[0] - a_m_[1] * velocity_i[1];
  }

 private:
  double lambda() const { return v_.lambda; }

  const Projection& v_;
  const double* const* x_;
  const double* a_;
  double a_b_[3], a_w_[3], a_i_[3], a_m_[3];
};

// Returns a sum over what was written, which is finite only if all is.
double WriteJacobians(const FactorBatch& batch, int i, int num_slots, const BodyReprojectionFamily::Measurement& measurement,
                      const Projection& v) {
  const double* U = measurement.sqrt_information;
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(i) * num_slots;
  double sum = 0.0;
  for (int r = 0; r < 2; ++r) {
    // U ∂(h_xy/h_z)/∂h, with ∂(h_xy/h_z)/∂h = [I | −u] / h_z.
    const double u_0 = r == 0 ? U[0] : 0.0, u_1 = r == 0 ? U[1] : U[2];
    const double a[3] = {u_0 / v.h[2], u_1 / v.h[2], -(u_0 * v.u[0] + u_1 * v.u[1]) / v.h[2]};
    const Rows rows(v, batch.parameters + first, a);
    for (int s = 0; s < num_slots; ++s) {
      const TangentMap& map = *batch.tangent_maps[first + s];
      if (!map.wanted()) {
        continue;
      }
      const JacobianView& view = batch.jacobians[s];
      double* row = view.data + i * view.factor_stride + r * view.row_stride;
      switch (s) {
        case kPoseI:
          rows.PoseI(row);
          break;
        case kPoseJ:
          rows.PoseJ(row);
          break;
        case kCamera:
          rows.Camera(row);
          break;
        case kFeature:
          rows.Feature(map.tangent_size > 1, row);
          break;
        default:
          rows.TimeOffset(measurement.velocity_i, u_0 * measurement.velocity_j[0] + u_1 * measurement.velocity_j[1], row);
      }
      if (s <= kCamera) {
        internal::AssertPoseManifold(map, batch.parameters[first + s]);
      }
      for (int k = 0; k < map.tangent_size; ++k) {
        sum += row[k];
      }
    }
  }
  return sum;
}

std::vector<FactorFamily::Slot> SlotsOf(BodyReprojectionFamily::TimeOffset offset, BodyReprojectionFamily::Feature feature) {
  const int size = feature == BodyReprojectionFamily::Feature::kBearing ? 3 : 1;
  std::vector<FactorFamily::Slot> slots{{7, 6}, {7, 6}, {7, 6}, {size, size}};
  if (offset == BodyReprojectionFamily::TimeOffset::kEstimated) {
    slots.push_back({1, 1});
  }
  return slots;
}

}  // namespace

BodyReprojectionFamily::BodyReprojectionFamily(TimeOffset offset, Feature feature) : FactorFamily(2, SlotsOf(offset, feature)) {
}

EvaluationFailure BodyReprojectionFamily::Evaluate(const FactorBatch& batch) const {
  for (int i = batch.begin; i < batch.end; ++i) {
    const Measurement& measurement = measurements_[static_cast<std::size_t>(i)];
    const double* const* x = batch.parameters + static_cast<std::ptrdiff_t>(i) * num_slots();
    const bool estimated = num_slots() > kTimeOffset;
    Projection v;
    // Without an offset the features stay where they are.
    const double tau = estimated ? x[kTimeOffset][0] : measurement.offset_i;
    Project(x, slot(kFeature).ambient_size > 1, tau, measurement, &v);
    double e[2];
    for (int k = 0; k < 2; ++k) {
      e[k] = v.u[k] - measurement.point_j[k] + (estimated ? (tau - measurement.offset_j) * measurement.velocity_j[k] : 0.0);
    }
    const double* U = measurement.sqrt_information;
    double* residual = batch.residuals + 2 * static_cast<std::ptrdiff_t>(i);
    residual[0] = U[0] * e[0] + U[1] * e[1];
    residual[1] = U[2] * e[1];
    if (!std::isfinite(residual[0] + residual[1])) {
      return {i, v.h[2] == 0.0 ? "the feature lies in the observing camera's plane (depth 0)" : "a residual is not finite"};
    }
    if (batch.jacobians != nullptr && !std::isfinite(WriteJacobians(batch, i, num_slots(), measurement, v))) {
      return {i, "a Jacobian entry is not finite"};
    }
  }
  return {};
}

}  // namespace inceres
