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

// Of one variable after the other.
// It adds to a count that other variables have begun: maxima and sums, so that their order does not
// matter. A factor of two of them is counted twice.
class StalenessOf {
 public:
  // `frame_step`: of all rows of S; null: all zeros.
  StalenessOf(const IncrementalSystem& system, const double* frame_step, FactorStaleness* staleness)
      : system_(system), schur_(system.schur()), frame_step_(frame_step), staleness_(*staleness) {}

  void AddVariable(VariableId id) {
    const int frame = system_.FrameOf(id);
    // A landmark's own step follows from those of its frames.
    if (frame < 0) {
      AddLandmark(system_.LandmarkOf(id));
      AddStep(schur_.landmarks()[system_.LandmarkOf(id)]);
      return;
    }
    AddFactors(schur_.frames()[frame].factors);
    // Factors with a landmark are listed with the landmark only.
    for (const std::int32_t landmark : schur_.frames()[frame].landmarks) {
      AddLandmark(landmark);
    }
    for (int k = schur_.FrameOffset(frame);
         frame_step_ != nullptr && k < schur_.FrameOffset(frame + 1); ++k) {
      AddStep(frame_step_[k]);
    }
  }

 private:
  void AddLandmark(std::int32_t l) {
    AddFactors(schur_.landmarks()[l].factors);
    // Outside S its last λ is of a contribution that is gone.
    if (schur_.IsInS(l)) {
      staleness_.landmark_damping =
          std::max(staleness_.landmark_damping, schur_.blocks().lambda(l));
    }
  }
  void AddFactors(const std::vector<FactorRef>& factors) {
    for (const FactorRef& ref : factors) {
      const IncrementalFamily& family = system_.families()[ref.family];
      const double error = family.weighed().SquaredError(ref.factor);
      // Any error counts as stale, however far below the limits of relinearization. A dirty factor
      // is another function, of which the error says nothing.
      if (error > 0.0 || system_.IsDirty(ref)) {
        ++staleness_.num_stale_factors;
        staleness_.largest_residual_error =
            std::max(staleness_.largest_residual_error, std::sqrt(error));
      }
    }
  }
  // δ_l = U_invᵀ (z − Yᵀ δ_c) of the step of the frames that is still to take.
  void AddStep(const IncrementalSchur::Landmark& landmark) {
    std::vector<double> padded(std::size_t(system_.variables().num_quads()) * kQuad, 0.0);
    for (const std::int32_t frame : landmark.frames) {
      // A held frame has no step, whatever is left in its entries.
      if (frame_step_ != nullptr && !schur_.frames()[frame].held) {
        std::copy_n(frame_step_ + schur_.FrameOffset(frame), schur_.frames()[frame].size,
                    padded.begin() + std::ptrdiff_t{schur_.frames()[frame].quad} * kQuad);
      }
    }
    const auto l = static_cast<std::int32_t>(&landmark - schur_.landmarks().data());
    // Zero outside S.
    schur_.blocks().BackSubstitute(l, padded.data());
    for (int k = 0; k < landmark.size; ++k) {
      AddStep(padded[std::ptrdiff_t{landmark.quad} * kQuad + k]);
    }
  }
  void AddStep(double step) {
    staleness_.largest_pending_step = std::max(staleness_.largest_pending_step, std::fabs(step));
  }

  const IncrementalSystem& system_;
  const IncrementalSchur& schur_;
  const double* frame_step_;
  FactorStaleness& staleness_;
};

}  // namespace

void CountStaleness(const IncrementalSystem& system, const std::vector<double>& frame_step,
                    VariableId id, FactorStaleness* staleness) {
  // Since S has other rows no step was solved for.
  const bool is_known = frame_step.size() == static_cast<std::size_t>(system.schur().size());
  StalenessOf(system, is_known ? frame_step.data() : nullptr, staleness).AddVariable(id);
}

}  // namespace inceres::internal
