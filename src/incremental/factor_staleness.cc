#include "incremental/factor_staleness.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace inceres::internal {

// What a covariance from the live factor leaves open (docs/algorithms.md, "From a live factor"):
// the factor of S is that of old linearizations, with damped landmarks, at values that a pending
// step would still move. All of it is known from caches: the error of an old linearization is ‖f −
// f̂‖, and a pending step is what FrameStep has not applied yet. Only variables that are asked for
// and their factors are looked at, of a frame also those of the landmarks that it sees.

namespace {

// What is counted adds to what other variables have begun: maxima and sums, so that their order
// does not matter. A factor of two of them is counted twice.
void CountFactors(const IncrementalSystem& system, const std::vector<FactorRef>& factors,
                  FactorStaleness* staleness) {
  for (const FactorRef& ref : factors) {
    const IncrementalFamily& family = system.families()[ref.family];
    const double error = family.weighed().SquaredError(ref.factor);
    // Any error counts as stale, however far below the limits of relinearization. A dirty factor
    // is another function, of which the error says nothing.
    if (error > 0.0 || system.IsDirty(ref)) {
      ++staleness->num_stale_factors;
      staleness->largest_residual_error =
          std::max(staleness->largest_residual_error, std::sqrt(error));
    }
  }
}

void CountLandmark(const IncrementalSystem& system, std::int32_t l, FactorStaleness* staleness) {
  const IncrementalSchur& schur = system.schur();
  CountFactors(system, schur.landmarks()[l].factors, staleness);
  // Outside S its last λ is of a contribution that is gone.
  if (schur.IsInS(l)) {
    staleness->landmark_damping = std::max(staleness->landmark_damping, schur.blocks().lambda(l));
  }
}

void CountStep(const double* step, int size, FactorStaleness* staleness) {
  for (int k = 0; k < size; ++k) {
    staleness->largest_pending_step = std::max(staleness->largest_pending_step, std::fabs(step[k]));
  }
}

// δ_l = U_invᵀ (z − Yᵀ δ_c) of the step of the frames that is still to take; null: all zeros.
void CountLandmarkStep(const IncrementalSystem& system, const double* frame_step, std::int32_t l,
                       FactorStaleness* staleness) {
  const IncrementalSchur& schur = system.schur();
  const IncrementalSchur::Landmark& landmark = schur.landmarks()[l];
  std::vector<double> padded(std::size_t(system.variables().num_quads()) * kQuad, 0.0);
  for (const std::int32_t frame : landmark.frames) {
    // A held frame has no step, whatever is left in its entries.
    if (frame_step != nullptr && !schur.frames()[frame].held) {
      std::copy_n(frame_step + schur.FrameOffset(frame), schur.frames()[frame].size,
                  padded.begin() + std::ptrdiff_t{schur.frames()[frame].quad} * kQuad);
    }
  }
  // Zero outside S.
  schur.blocks().BackSubstitute(l, padded.data());
  CountStep(padded.data() + std::ptrdiff_t{landmark.quad} * kQuad, landmark.size, staleness);
}

}  // namespace

void CountStaleness(const IncrementalSystem& system, const std::vector<double>& frame_step,
                    VariableId id, FactorStaleness* staleness) {
  const IncrementalSchur& schur = system.schur();
  // Since S has other rows no step was solved for.
  const bool is_known = frame_step.size() == static_cast<std::size_t>(schur.size());
  const double* const step = is_known ? frame_step.data() : nullptr;
  const int frame = system.FrameOf(id);
  // A landmark's own step follows from those of its frames.
  if (frame < 0) {
    CountLandmark(system, system.LandmarkOf(id), staleness);
    CountLandmarkStep(system, step, system.LandmarkOf(id), staleness);
    return;
  }
  CountFactors(system, schur.frames()[frame].factors, staleness);
  // Factors with a landmark are listed with the landmark only.
  for (const std::int32_t landmark : schur.frames()[frame].landmarks) {
    CountLandmark(system, landmark, staleness);
  }
  if (step != nullptr) {
    CountStep(step + schur.FrameOffset(frame),
              schur.FrameOffset(frame + 1) - schur.FrameOffset(frame), staleness);
  }
}

}  // namespace inceres::internal
