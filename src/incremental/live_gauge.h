#pragma once

#include <vector>

#include "inceres/status.h"
#include "incremental/incremental_schur.h"
#include "incremental/incremental_system.h"
#include "linear/live_factor.h"

namespace inceres::internal {

/// The weakest direction of D^−½ S D^−½, D = diag(C), remembered from one covariance to the next,
/// for to find it takes solves: what damping may hide, and whether the gauge is free.
struct WeakestDirection {
  double eigenvalue = 0.0;
  double of_landmarks = 0.0;     // what of it is the landmarks' damping
  double damping_share = 0.0;    // the largest that this has of xᵀSx, over all directions x
  double mu = 0.0;               // of the factor it was looked for with
  VariableId variable = -1;      // with the largest share in it
  int num_frames = 0;            // when it was looked for
  bool is_known = false;         // and nothing was taken out of the graph since
  std::vector<VariableId> seen;  // by row: frames that were there then, or were looked at since
  int num_seen = 0;
  // by family and place, where there are losses: 1/√w of the linearizations it was looked for with
  std::vector<std::vector<double>> inverse_sqrt_w;
};

/// Whether it need not be looked for: what has come since is little, and FindFreeNewFrame looks
/// at it; and losses have not taken so much weight that another direction may have less than
/// `open`. With a factor of S + μD: one with more hides what landmarks' damping does. Cost: a look
/// at the weight of each factor of a family with losses.
bool IsStillKnown(const WeakestDirection& weakest, const IncrementalSystem& system, double mu,
                  double open);

/// By inverse iteration with a factor of S + μD. Errors are the factor's.
Status FindWeakest(const IncrementalSystem& system, const LiveFactor& factor, double mu,
                   WeakestDirection* weakest);

/// Whether more than `open` holds it, and mostly not the landmarks' damping.
bool IsHeld(const WeakestDirection& weakest, double open);

/// The first frame that has come since and is part of something that is not held, by `open`; -1 if
/// there is none, and all are seen. What was held before cannot get free by what comes, so that
/// only the new frames' own block of S is looked at, with the others held.
VariableId FindFreeNewFrame(const IncrementalSchur& schur, double open, WeakestDirection* weakest);

}  // namespace inceres::internal
