#pragma once

#include <petscvec.h>

#include <cstdint>
#include <vector>

#include "distributed/communicator.h"
#include "distributed/petsc_objects.h"
#include "distributed/shared_frames.h"

namespace inceres::internal {

/// Moves values of frames between the ranks that have them and their owners: of the frames a rank
/// sees, and of no others. Values are packed: of what is here in the order of `places`, of what is
/// owned in the order of its numbers. Sums are taken in an order that depends on the partition
/// alone.
class FrameExchange {
 public:
  /// Collective, as all calls. `kind`: FramePlace::kTangent, …
  FrameExchange(const Communicator& ranks, const SharedFrames& frames,
                const std::vector<FramePlace>& places, int kind);

  /// here := what the owners have.
  void Spread(const double* owned, double* here);
  /// owned := the sums of what all ranks have.
  void Collect(const double* here, double* owned);

  /// Entries of this rank, as it has them and as it owns them.
  std::int64_t here_size() const { return here_size_; }
  std::int64_t owned_size() const { return owned_size_; }
  /// Bytes that this rank sends in one Spread and one Collect, by the plan.
  std::int64_t bytes_per_round() const { return bytes_per_round_; }
  /// Seconds spent exchanging.
  double seconds() const { return seconds_; }

 private:
  void Scatter(const double* from, double* to, bool collect);

  std::int64_t here_size_ = 0;
  std::int64_t owned_size_ = 0;
  std::int64_t bytes_per_round_ = 0;
  double seconds_ = 0.0;
  double nothing_ = 0.0;  // where vectors without entries are
  PetscOwned<Vec, VecDestroy> owned_;
  PetscOwned<Vec, VecDestroy> here_;
  PetscOwned<VecScatter, VecScatterDestroy> scatter_;
};

}  // namespace inceres::internal
