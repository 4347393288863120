#include "incremental/factor_staleness.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace inceres::internal {
namespace {

// Of one variable after the other.
class StalenessOf {
 public:
  StalenessOf(const IncrementalSystem& system, const std::vector<double>& frame_step,
              FactorStaleness* staleness)
      : system_(system), schur_(system.schur()), frame_step_(frame_step), staleness_(*staleness) {}

  void AddVariable(VariableId id) {
    const int frame = system_.FrameOf(id);
    if (frame < 0) {
      AddLandmark(system_.LandmarkOf(id));
      AddStep(schur_.landmarks()[system_.LandmarkOf(id)]);
      return;
    }
    AddFactors(schur_.frames()[frame].factors);
    for (const std::int32_t landmark : schur_.frames()[frame].landmarks) {
      AddLandmark(landmark);
    }
    for (int k = schur_.FrameOffset(frame); k < schur_.FrameOffset(frame + 1); ++k) {
      AddStep(frame_step_[k]);
    }
  }

 private:
  void AddLandmark(std::int32_t l) {
    AddFactors(schur_.landmarks()[l].factors);
    if (schur_.IsInS(l)) {
      staleness_.landmark_damping =
          std::max(staleness_.landmark_damping, schur_.blocks().lambda(l));
    }
  }
  void AddFactors(const std::vector<FactorRef>& factors) {
    for (const FactorRef& ref : factors) {
      const IncrementalFamily& family = system_.families()[ref.family];
      const double error = family.SquaredError(ref.factor);
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
      const int size = schur_.frames()[frame].held ? 0 : schur_.frames()[frame].size;
      std::copy_n(frame_step_.begin() + schur_.FrameOffset(frame), size,
                  padded.begin() + std::ptrdiff_t{schur_.frames()[frame].quad} * kQuad);
    }
    const auto l = static_cast<std::int32_t>(&landmark - schur_.landmarks().data());
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
  const std::vector<double>& frame_step_;
  FactorStaleness& staleness_;
};

}  // namespace

void CountStaleness(const IncrementalSystem& system, const std::vector<double>& frame_step,
                    VariableId id, FactorStaleness* staleness) {
  // Since S has other rows no step was solved for.
  const bool is_known = frame_step.size() == static_cast<std::size_t>(system.schur().size());
  const std::vector<double> none(is_known ? 0 : system.schur().size(), 0.0);
  StalenessOf(system, is_known ? frame_step : none, staleness).AddVariable(id);
}

}  // namespace inceres::internal
