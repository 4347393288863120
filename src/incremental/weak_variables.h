#pragma once

#include <cstdint>
#include <vector>

#include "incremental/incremental_schur.h"
#include "incremental/index_set.h"

namespace inceres::internal {

/// The variables of a living problem that have a direction which is weak against the scale of
/// their coordinates even while the others stay: a pivot of the frame's block of S is small against
/// its entry of diag C, or one of the landmark's P + λD against that of P, or it is mostly damping.
/// There a small error of the gradient hides much.
class WeakVariables {
 public:
  explicit WeakVariables(IncrementalSchur* schur) : schur_(*schur) {}

  /// Calls visit(factor) for the factors that touch one; for some of them twice. Cost: the frames
  /// whose rows of S have changed since, and the factors.
  template <typename Visit>
  void ForEachFactor(const Visit& visit) {
    Follow();
    const IncrementalStructure& structure = schur_.structure();
    schur_.blocks().ForEachWeak([&](std::int32_t landmark) {
      for (const FactorRef& ref : structure.landmarks()[landmark].factors) {
        visit(ref);
      }
    });
    frames_.ForEach([&](std::int32_t frame) {
      for (const FactorRef& ref : structure.frames()[frame].factors) {
        visit(ref);
      }
      for (const std::int32_t landmark : structure.frames()[frame].landmarks) {
        structure.ForEachFactorBetween(landmark, frame, visit);
      }
    });
  }

 private:
  void Follow();
  bool IsWeak(std::int32_t frame);

  IncrementalSchur& schur_;
  IndexSet frames_;
  std::vector<std::int32_t> changed_;  // rows of S
  std::vector<double> block_;          // scratch, of one frame
  std::vector<double> inverse_pivots_;
};

}  // namespace inceres::internal
