#pragma once

#include "common/frame.h"
#include "common/imu_preintegration.h"

namespace sliding_window {

/// The state of frame j predicted from that of frame i.
ImuState Propagate(const ImuPreintegration& imu, const ImuState& i);

/// r = W [R_i^T (p_j - p_i - v_i dt + g dt^2 / 2) - delta_p;  2 vec(delta_q^-1 q_i^-1 q_j);  R_i^T
/// (v_j - v_i + g dt) - delta_v;
///        ba_j - ba_i;  bg_j - bg_i]
///
/// with the deltas corrected to first order for biases away from those of the integration, and its
/// derivatives (15 x 15) with respect to p, theta (q Exp(theta)), v, ba, bg of both states. J_i and
/// J_j may be null, both or neither.
void EvaluateImuResidual(const ImuPreintegration& imu, const ImuState& i, const ImuState& j,
                         ImuPreintegration::Vector15* r, ImuPreintegration::Matrix15* J_i,
                         ImuPreintegration::Matrix15* J_j);

}  // namespace sliding_window
