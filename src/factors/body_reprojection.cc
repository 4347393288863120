#include "inceres/factors/body_reprojection.h"

#include <cmath>

#include "factors/image_error.h"
#include "factors/inverse_depth_chain.h"
#include "factors/whiten.h"

// An inverse-depth feature between two views from a body, in the letters of the header: the chain m
// → body at i → world → body at j → h is in inverse_depth_chain.h, for all combinations of one or
// two poses and cameras; here is the end of the chain. The error of h against z is e(h, z), whose
// derivative A = ∂e/∂h is whitened once, a = U A; each row of a then goes back along the chain and
// gives the rows of all slots. The time offset τ enters twice: through z, in e_tau, and through m,
// which moves with the features of frame i.

namespace inceres {
namespace {

using internal::InverseDepthChain;
using internal::InverseDepthRow;
using Measurement = BodyReprojectionFamily::Measurement;
using Error = BodyReprojectionFamily::Error;
using Feature = BodyReprojectionFamily::Feature;
using Views = BodyReprojectionFamily::Views;

// The error of one observation before whitening, with A = ∂e/∂h and e_tau = ∂e/∂τ through the
// observation itself.
struct Observed {
  double e[2];
  double A[2][3];
  double e_tau[2];
};

// B (z, 1) / ‖(z, 1)‖ at z moves by −B (I − d dᵀ) / ‖(z, 1)‖ · (ż, 0) with τ; e has it with a
// minus.
// B is fixed at z_j, not at z(τ): it does not move with τ, and its derivative is not needed. d and
// h / ‖h‖ are compared in it.
void OnSphere(const double h[3], const Measurement& measurement, const double z[2],
              bool differentiate, Observed* v) {
  double B[2][3];
  double seen[3] = {measurement.point_j[0], measurement.point_j[1], 1.0};
  double d[3] = {z[0], z[1], 1.0};
  const double seen_norm = internal::Norm(seen), norm = internal::Norm(d);
  for (int k = 0; k < 3; ++k) {
    seen[k] /= seen_norm;
    d[k] /= norm;
  }
  internal::TangentBasis(seen, B);
  internal::SphereError(h, d, B, v->e, differentiate ? v->A : nullptr);
  const double* rate = measurement.velocity_j;
  const double radial = d[0] * rate[0] + d[1] * rate[1];
  // (ż, 0) has no third component, so two products make B ż and the part along d.
  for (int r = 0; r < 2; ++r) {
    v->e_tau[r] = (B[r][0] * rate[0] + B[r][1] * rate[1] - internal::Dot(B[r], d) * radial) / norm;
  }
}

void Observe(const double h[3], const Measurement& measurement, double tau, Error error,
             bool differentiate, Observed* v) {
  double z[2];
  for (int k = 0; k < 2; ++k) {
    // z = z_j − (τ − τ_j) ż and e has −z: in the plane ∂e/∂τ = ż.
    z[k] = measurement.point_j[k] - (tau - measurement.offset_j) * measurement.velocity_j[k];
    v->e_tau[k] = measurement.velocity_j[k];
  }
  if (error == Error::kPlane) {
    internal::PlaneError(h, z, v->e, differentiate ? v->A : nullptr);
  } else {
    OnSphere(h, measurement, z, differentiate, v);
  }
}

// Returns a sum over what was written, which is finite only if all is.
template <int poses, int cameras>
double WriteJacobians(const FactorBatch& batch, int i, int num_slots,
                      const Measurement& measurement,
                      const InverseDepthChain<poses, cameras>& chain, const Observed& v) {
  using Chain = InverseDepthChain<poses, cameras>;
  const std::ptrdiff_t first = static_cast<std::ptrdiff_t>(i) * num_slots;
  double U[4];
  internal::UnpackUpper(measurement.sqrt_information, U);
  // Whitened before it goes back along the chain: two rows are multiplied by U, not the Jacobians
  // of all slots.
  double a[2][3], by_tau[2];
  internal::MultiplyUpper<2, 3>(U, v.A[0], a[0], 3);
  internal::MultiplyUpper<2, 1>(U, v.e_tau, by_tau, 1);
  double sum = 0.0;
  for (int r = 0; r < 2; ++r) {
    const InverseDepthRow<poses, cameras> writer(chain, a[r]);
    // Both rows of a slot are written in turn; the chain's intermediate vectors are computed once a
    // row.
    for (int s = 0; s < num_slots; ++s) {
      const TangentMap& map = *batch.tangent_maps[first + s];
      if (!map.wanted()) {
        continue;
      }
      const JacobianView& view = batch.jacobians[s];
      double* row = view.data + i * view.factor_stride + r * view.row_stride;
      // Through z directly and through m = m_i − (τ − τ_i) ṁ_i by the chain.
      if (s == Chain::kTimeOffset) {
        const double* a_m = writer.by_m();
        row[0] =
            by_tau[r] - a_m[0] * measurement.velocity_i[0] - a_m[1] * measurement.velocity_i[1];
      } else if (s == Chain::kFeature) {
        writer.WriteFeature(map.tangent_size > 1, row);
      } else {
        writer.WritePose(s, row);
      }
      // Poses and cameras come before the feature, and only they are on a manifold.
      if (s < Chain::kFeature) {
        internal::AssertPoseManifold(map, batch.parameters[first + s]);
      }
      for (int k = 0; k < map.tangent_size; ++k) {
        sum += row[k];
      }
    }
  }
  return sum;
}

// Cameras count as poses here: both are (7, 6).
std::vector<FactorFamily::Slot> SlotsOf(BodyReprojectionFamily::TimeOffset offset, Feature feature,
                                        Views views) {
  const int num_poses = views == Views::kTwoPosesTwoCameras ? 4 : views == Views::kTwoPoses ? 3 : 2;
  std::vector<FactorFamily::Slot> slots(static_cast<std::size_t>(num_poses), {7, 6});
  const int feature_size = feature == Feature::kBearing ? 3 : 1;
  slots.push_back({feature_size, feature_size});
  if (offset == BodyReprojectionFamily::TimeOffset::kEstimated) {
    slots.push_back({1, 1});
  }
  return slots;
}

// The plane has no image of h_z = 0, the sphere none of h = 0.
const char* ReasonAt(const double h[3], Error error) {
  if (error == Error::kPlane && h[2] == 0.0) {
    return "the feature lies in the observing camera's plane (depth 0)";
  }
  if (error == Error::kUnitSphere && internal::Norm(h) == 0.0) {
    return "the feature lies in the center of the observing camera";
  }
  return "a residual is not finite";
}

}  // namespace

BodyReprojectionFamily::BodyReprojectionFamily(TimeOffset offset, Feature feature, Views views,
                                               Error error)
    : MeasuredFamily(2, SlotsOf(offset, feature, views)),
      offset_(offset),
      feature_(feature),
      views_(views),
      error_(error) {
}

template <int poses, int cameras>
EvaluationFailure BodyReprojectionFamily::EvaluateViews(const FactorBatch& batch) const {
  using Chain = InverseDepthChain<poses, cameras>;
  const bool estimated = offset_ == TimeOffset::kEstimated;
  for (int i = batch.begin; i < batch.end; ++i) {
    const Measurement& measurement = this->measurement(i);
    const double* const* x = batch.parameters + static_cast<std::ptrdiff_t>(i) * num_slots();
    // Without an offset the features stay where they are.
    const double delay_i = estimated ? x[Chain::kTimeOffset][0] - measurement.offset_i : 0.0;
    // With τ = τ_j the observation does not move: z is z_j exactly.
    const double tau = estimated ? x[Chain::kTimeOffset][0] : measurement.offset_j;
    const bool has_bearing = feature_ == Feature::kBearing;
    const double* bearing = has_bearing ? x[Chain::kFeature] : measurement.point_i;
    const Chain chain(x, bearing[0] - delay_i * measurement.velocity_i[0],
                      bearing[1] - delay_i * measurement.velocity_i[1],
                      x[Chain::kFeature][has_bearing ? 2 : 0]);
    Observed v;
    Observe(chain.h, measurement, tau, error_, batch.jacobians != nullptr, &v);
    const double* U = measurement.sqrt_information;
    double* residual = batch.residuals + 2 * static_cast<std::ptrdiff_t>(i);
    residual[0] = U[0] * v.e[0] + U[1] * v.e[1];
    residual[1] = U[2] * v.e[1];
    if (!std::isfinite(residual[0] + residual[1])) {
      return {i, ReasonAt(chain.h, error_)};
    }
    // The chain of the residual is used again: value and Jacobians are of one computation.
    if (batch.jacobians != nullptr &&
        !std::isfinite(WriteJacobians(batch, i, num_slots(), measurement, chain, v))) {
      return {i, "a Jacobian entry is not finite"};
    }
  }
  return {};
}

// The views decide the template once a call, so that the loops have constant numbers of slots.
EvaluationFailure BodyReprojectionFamily::Evaluate(const FactorBatch& batch) const {
  switch (views_) {
    case Views::kTwoPosesTwoCameras:
      return EvaluateViews<2, 2>(batch);
    case Views::kOnePoseTwoCameras:
      return EvaluateViews<0, 2>(batch);
    default:
      return EvaluateViews<2, 1>(batch);
  }
}

}  // namespace inceres
