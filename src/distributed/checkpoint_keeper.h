#pragma once

#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "distributed/checkpoint.h"
#include "distributed/communicator.h"
#include "distributed/shared_frames.h"
#include "inceres/distributed/distributed_solver.h"
#include "linearize/layout.h"
#include "trust_region/loop_options.h"

namespace inceres::internal {

/// Writes the checkpoints of a solve, and goes on from one. All ranks write at once: each the
/// frames it owns and its landmarks, into one file that is renamed when all are done.
class CheckpointKeeper final : public PositionKeeper {
 public:
  CheckpointKeeper(const DistributedOptions& options, const Communicator& ranks,
                   const GraphPart& part, const SharedFrames& frames, const Layout& layout);

  bool Wants(int iteration) const override;
  /// A failure is remembered, and the solve goes on. Collective.
  void Keep(const LoopPosition& position, const std::vector<double>& state) override;

  /// Reads CheckpointOptions::resume: the values of what moves into *state. Any number of ranks may
  /// have written it. Collective; the Status is the same on all.
  Status Resume(LoopPosition* position, std::vector<double>* state) const;

  int num_written() const { return num_written_; }
  const std::string& failure() const { return failure_; }

 private:
  std::vector<char> EncodeOwn(const LoopPosition& position, const std::vector<double>& state) const;
  Status Write(const LoopPosition& position, const std::vector<double>& state) const;
  // By id, the positions in the layout of frames and of landmarks.
  using Places = std::unordered_map<std::int64_t, std::size_t>;
  Status CheckHead(const CheckpointHead& head) const;
  void FindPlaces(Places* frames, Places* landmarks) const;
  bool Fits(const CheckpointRecord& record, VariableId variable, const double* values,
            const double* scale) const;
  Status Read(LoopPosition* position, std::vector<double>* state) const;
  Status CheckOwnLandmarks() const;
  Status CheckLandmarks() const;

  const DistributedOptions& options_;
  const Communicator& ranks_;
  const GraphPart& part_;
  const SharedFrames& frames_;
  const Layout& layout_;
  std::vector<std::int64_t> landmark_ids_;  // in the order of the layout; −1 if it is not listed
  std::int64_t num_landmarks_ = 0;          // of all ranks
  Status checked_;                          // whether the ids of all ranks will do
  int num_written_ = 0;
  std::string failure_;
};

}  // namespace inceres::internal
